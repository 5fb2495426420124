"""The check that ``step_many`` and ``estimate_many`` of a filter give the same bits as one device at a time, on
devices that differ in all that can differ."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from tickfix.api import Belief, Motion, Observation, Prior, Report, Rng, pack
from tickfix.testing import world
from tickfix.testing.contract import pure_call, require

N_DEVICES: Final = 7

StepPair = tuple[Any, Report]
TickInput = tuple[Motion, Sequence[Observation]]


def device_inputs(ticks: int) -> list[list[TickInput]]:
    """Return what each device is given, tick by tick.

    They walk elsewhere and from another moment on; one has no compass, one no motion now and then, one stands, one has
    no fixes, one several in one tick, and one climbs the stairs.
    """
    walks = []
    for d in range(N_DEVICES):
        walk = world.walk(ticks + 5 * d, shift=(0.5 * d, 0.25 * d), compass=d != 1, fixes=d != 4)
        walks.append([_tick_input(d, tick) for tick in list(walk)[-ticks:]])
    return walks


def _tick_input(d: int, tick: world.WalkTick) -> TickInput:
    motion, observations = tick.motion, tick.observations
    t_ns = motion.t1_ns
    if d == 2 and tick.number % 3 == 0:
        motion = Motion.unknown(motion.t0_ns, t_ns)
    if d == 3:
        motion = Motion(t0_ns=motion.t0_ns, t1_ns=t_ns, heading_rad=0.0, stationary=True)
    if d == 5 and tick.number % 4 == 0:
        observations = tuple(world.observation(tick.xy + n, t_ns) for n in range(3))
    if d == 6 and tick.number % 3 == 0:
        observations = (world.observation(tick.xy, t_ns, "F2"),)
    return motion, observations


def groupings() -> Iterator[tuple[str, list[list[int]]]]:
    """Yield ways in which the devices may be asked for, and what to call each."""
    every = list(range(N_DEVICES))
    yield "all together", [every]
    yield "all together, in another order", [every[::-1]]
    yield "each in a batch of its own", [[d] for d in every]
    yield "in batches of three", [every[4:], every[1:4], every[:1]]


def check_step_many(algorithm: Any, ticks: int) -> None:
    """Fail unless ``step_many`` and ``estimate_many`` return what ``step`` and ``estimate`` return, to the bit."""
    walks = device_inputs(ticks)
    fixes = [world.first_fix((0.5 * d, 0.25 * d)) for d in range(N_DEVICES)]
    states = [algorithm.start(Prior(t_ns=fix.t_ns, fix=fix), _rng(d, 0)) for d, fix in enumerate(fixes)]
    tolerance = declared_tolerance(algorithm)
    for k in range(ticks):
        given = [walk[k] for walk in walks]
        before = [pack(state) for state in states]
        one_by_one = [algorithm.step(states[d], *given[d], _rng(d, k + 1)) for d in range(N_DEVICES)]
        believed = [algorithm.estimate(state) for state, _ in one_by_one]
        for how, groups in groupings():
            for group in groups:
                stepped = _checked_step_many(algorithm, [states[d] for d in group], [given[d] for d in group], group, k)
                beliefs = _checked_estimate_many(algorithm, [state for state, _ in stepped])
                for d, (state, report), belief in zip(group, stepped, beliefs, strict=True):
                    where = f"of device {d} of {N_DEVICES}, asked for {how}, at tick {k + 1}"
                    require_same("step_many", "state", state, one_by_one[d][0], where, tolerance)
                    require_same("step_many", "report", report, one_by_one[d][1], where, tolerance)
                    require_same("estimate_many", "belief", belief, believed[d], where, tolerance)
        unchanged = [pack(state) for state in states] == before
        require(unchanged, "step_many changed a state it was given. Write into copies, return new states")
        states = [state for state, _ in one_by_one]


def declared_tolerance(algorithm: Any) -> float:
    """Return the ``batch_tolerance`` of an algorithm, 0 where it declares none; fail if it is no small number ≥ 0."""
    tolerance = float(getattr(algorithm, "batch_tolerance", 0.0))
    require(0.0 <= tolerance < 1.0, f"batch_tolerance is {tolerance}. Set it to 0 (bit for bit) or a small number")
    return tolerance


def _rng(d: int, k: int) -> Rng:
    return world.rng(11, d, k)


def _checked_step_many(
    algorithm: Any, states: Sequence[Any], given: Sequence[TickInput], group: Sequence[int], k: int
) -> Sequence[StepPair]:
    motions, observations = [motion for motion, _ in given], [seen for _, seen in given]
    with pure_call(f"step_many at tick {k + 1}"):
        stepped: Sequence[StepPair] = algorithm.step_many(
            states, motions, observations, [_rng(d, k + 1) for d in group]
        )
    found = f"step_many of {len(group)} devices returned {len(stepped)} results"
    require(len(stepped) == len(group), f"{found}. Return a pair (state, Report) for each, in the order given")
    return stepped


def _checked_estimate_many(algorithm: Any, states: Sequence[Any]) -> Sequence[Belief]:
    with pure_call("estimate_many"):
        beliefs: Sequence[Belief] = algorithm.estimate_many(states)
    found = f"estimate_many of {len(states)} states returned {len(beliefs)} beliefs"
    require(len(beliefs) == len(states), f"{found}. Return one for each, in the order given")
    return beliefs


def _packed(value: Any) -> bytes:
    return pack(tuple(sorted(value.items())) if isinstance(value, Mapping) else value)


def _is_close(found: Any, expected: Any, tolerance: float) -> bool:
    """Tell whether all numbers within two values agree within ``tolerance``, and all else is equal."""
    if isinstance(expected, np.ndarray):
        alike = isinstance(found, np.ndarray) and found.shape == expected.shape and found.dtype == expected.dtype
        return alike and bool(np.allclose(found, expected, rtol=tolerance, atol=tolerance, equal_nan=True))
    if isinstance(expected, float):
        return isinstance(found, float) and math.isclose(found, expected, rel_tol=tolerance, abs_tol=tolerance)
    if isinstance(expected, Mapping):
        return list(found) == list(expected) and all(_is_close(found[k], expected[k], tolerance) for k in expected)
    if isinstance(expected, tuple):
        pairs = zip(found, expected, strict=False)
        return len(found) == len(expected) and all(_is_close(one, other, tolerance) for one, other in pairs)
    if dataclasses.is_dataclass(expected) and type(found) is type(expected):
        names = [f.name for f in dataclasses.fields(expected)]
        return all(_is_close(getattr(found, name), getattr(expected, name), tolerance) for name in names)
    return bool(found == expected)


def require_same(method: str, what: str, found: Any, expected: Any, where: str, tolerance: float) -> None:
    """Fail unless two values have the same bits, or agree within a tolerance > 0; names the fields that differ."""
    if tolerance > 0.0:
        require(
            _is_close(found, expected, tolerance),
            f"{method} gave another {what} {where}, than {method.removesuffix('_many')} gives of it alone: they differ "
            f"by more than batch_tolerance = {tolerance:g}. Raise it, or compute more precisely",
        )
        return
    same_type = type(found) is type(expected)
    fields = [f.name for f in dataclasses.fields(expected)] if same_type else []
    differ = [name for name in fields if _packed(getattr(found, name)) != _packed(getattr(expected, name))]
    if same_type and not differ:
        return
    require(
        condition=False,
        message=f"{method} gave another {what} {where}, than {method.removesuffix('_many')} gives of it alone: "
        f"{', '.join(differ) or type(found).__name__} differs. Sum along each device's own row, never by a matrix "
        "product over devices, and let each draw from its own rng what it draws alone",
    )
