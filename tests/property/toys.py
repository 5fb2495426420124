"""Algorithms whose every output is a hash of all they ever saw: whatever differs anywhere, shows."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from hashlib import blake2b
from typing import Any

import numpy as np

from tickfix.api import Belief, Fix, Motion, MotionSamples, Observation, Prior, Readings, Report, Rng, Window
from tickfix.kernel import Pipeline, Stage


@dataclass(frozen=True, slots=True)
class Chain:
    """A hash of everything so far, and how much that was."""

    digest: bytes = b""
    count: int = 0

    def on(self, *parts: Any) -> Chain:
        """Return the chain with more on it."""
        return Chain(blake2b(self.digest + plain(parts).encode(), digest_size=16).digest(), self.count + 1)

    def number(self, n: int) -> float:
        """Return one of a few numbers in [0, 1) that the hash makes."""
        return self.digest[n] / 256.0


def plain(value: Any) -> str:
    """Return a text that differs wherever values differ by a bit."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype}{value.shape}{value.tobytes().hex()}"
    if isinstance(value, (tuple, list)):
        return f"({','.join(map(plain, value))})"
    if is_dataclass(value):
        return f"{type(value).__name__}{plain([getattr(value, f.name) for f in fields(value)])}"
    return repr(value)


class ToyPdr:
    """Motion from a hash of the samples."""

    State = Chain

    def start(self) -> Chain:
        return Chain()

    def step(self, state: Chain, samples: MotionSamples) -> tuple[Chain, Motion]:
        rows = [(name, s.t_ns, s.values) for name, s in sorted(samples.sensors.items())]
        state = state.on(samples.t0_ns, samples.t1_ns, rows)
        heading = None if state.number(1) < 0.2 else 2 * math.pi * state.number(2)
        motion = Motion(
            t0_ns=samples.t0_ns,
            t1_ns=samples.t1_ns,
            distance_m=state.number(0),
            heading_rad=heading,
            travelled_m=state.count,
        )
        return state, motion


class ToyFingerprint:
    """A fix from a hash of the window, unless that is empty."""

    State = Chain

    def __init__(self, window: Window, *, redated: bool = False) -> None:
        self.window = window
        self._redated = redated

    def start(self) -> Chain:
        return Chain()

    def step(self, state: Chain, window: Readings) -> tuple[Chain, Observation]:
        parts = (window.transmitters, window.rssi_dbm, window.heard_ns, window.scan, window.scan_t_ns, window.source)
        state = state.on(window.t_ns, *parts)
        xy = np.array([state.number(0), state.number(1)])
        shift_ns = round(4e9 * (state.number(2) - 0.5)) if self._redated else 0
        fix = Fix(t_ns=window.t_ns + shift_ns, floor="F", xy=xy, covariance=np.eye(2)) if len(window) else None
        return state, Observation(t_ns=window.t_ns, source="toy", fix=fix)


class ToyFilter:
    """A belief from a hash of motion, observations and random numbers."""

    State = Chain

    def __init__(self, *, eager: bool = False) -> None:
        self._eager = eager

    def start(self, prior: Prior, rng: Rng) -> Chain | None:
        if prior.fix is None and not self._eager:
            return None
        return Chain().on(prior.t_ns, seen(prior.fix), rng.random())

    def step(self, state: Chain, motion: Motion, observations: Sequence[Observation], rng: Rng) -> tuple[Chain, Report]:
        fixes = [(o.t_ns, o.source, seen(o.fix)) for o in observations]
        state = state.on(motion, fixes, rng.random(), rng.standard_normal(2))
        return state, Report(used=len(observations), innovation_m=state.number(3) if observations else None)

    def estimate(self, state: Chain) -> Belief:
        return Belief(floor="F", xy=np.array([state.number(0), state.number(1)]), covariance=np.eye(2))


class ToySmoother(ToyFilter):
    """A smoothed belief from a hash of the states of the lag."""

    lag_s = 1.0

    def smooth(self, states: Sequence[Chain]) -> Belief:
        smoothed = Chain().on(*states)
        return Belief(floor="F", xy=np.array([smoothed.number(0), smoothed.number(1)]), covariance=np.eye(2))


def seen(fix: Fix | None) -> Any:
    """Return what of a fix matters."""
    return None if fix is None else (fix.t_ns, fix.floor, fix.xy, fix.covariance)


def toy_pipeline(
    name: str = "toy",
    *,
    window: Window | None = None,
    eager: bool = False,
    pdr: bool = True,
    fingerprint: bool = True,
    redated: bool = False,
    smoothing: bool = False,
) -> Pipeline:
    """Return a pipeline of toys."""
    window = window or Window(sources=("wifi", "ble"))
    return Pipeline(
        name,
        Stage("filter", "toy", f"filter {name}", (ToySmoother if smoothing else ToyFilter)(eager=eager)),
        Stage("pdr", "toy", "pdr", ToyPdr()) if pdr else None,
        Stage("fingerprint", "toy", f"fingerprint {window} {redated}", ToyFingerprint(window, redated=redated))
        if fingerprint
        else None,
    )


Fault = Callable[[str, int], str]
"""(method, time) → what goes wrong there: "raise", "nan", "type", "idle" (does nothing, rightly), or "" for nothing."""


class Sabotaged:
    """An algorithm that misbehaves where it is told to; all else it leaves to the one within."""

    def __init__(self, within: Any, fault: Fault) -> None:
        self._within = within
        self._fault = fault
        self.State = within.State

    def __getattr__(self, name: str) -> Any:
        return getattr(self._within, name)

    def step(self, state: Any, *args: Any) -> Any:
        first = args[0]
        fault = self._fault("step", first.t1_ns if hasattr(first, "t1_ns") else first.t_ns)
        if fault == "raise":
            raise RuntimeError("sabotage")
        if fault == "type":
            return "nonsense"
        if fault == "idle":
            return state, _idle(first)
        state, result = self._within.step(state, *args)
        return (state, result) if not fault else _poisoned(state, result)


def _idle(first: Any) -> Any:
    if isinstance(first, MotionSamples):
        return Motion.unknown(first.t0_ns, first.t1_ns)
    return Observation(t_ns=first.t_ns, source="idle") if isinstance(first, Readings) else Report()


def _poisoned(state: Any, result: Any) -> tuple[Any, Any]:
    if isinstance(result, Motion):
        return state, replace(result, distance_m=math.nan)
    if isinstance(result, Observation):
        fix = Fix(t_ns=result.t_ns, floor="F1", xy=np.full(2, np.nan))
        return state, replace(result, fix=fix)
    return with_nan(state), result


def with_nan(value: Any) -> Any:
    """Return a state with NaN in the first number that can hold it, however deep."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "f" and value.size:
        return np.full(value.shape, np.nan)
    if isinstance(value, float):
        return math.nan
    if is_dataclass(value) and not isinstance(value, type):
        for field in fields(value):
            inner = getattr(value, field.name)
            poisoned = with_nan(inner)
            if poisoned is not inner:
                return replace(value, **{field.name: poisoned})
    return value


def sabotaged(stage: Stage, fault: Fault) -> Stage:
    """Return the stage with an algorithm that misbehaves."""
    return Stage(stage.kind, stage.name, f"{stage.key} sabotaged {id(fault)}", Sabotaged(stage.algorithm, fault))
