"""A barometer of a third party tells filters by how much a device rose; transitions tell them where it can."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any

import numpy as np
import pytest

from tickfix import config
from tickfix.api import BaseFilter, Belief, Context, Fix, Motion, Pressure, Recording, Report, motion_samples
from tickfix.kernel import KernelSettings, Pipeline
from tickfix.kernel.stages import Stage
from tickfix.registry import discover
from tickfix.replay.driver import replay_recording
from tickfix.testing import PdrContract

Install = Callable[[str], list[EntryPoint]]
START = Fix(t_ns=0, floor="F1", xy=np.zeros(2), covariance=np.eye(2))


@pytest.fixture
def barometer(install: Install) -> type[Any]:
    """The third party's class, as discovered."""
    found = discover(install("barometer"))
    assert found.problems == ()
    return found.get("pdr", "barometer").cls


@dataclass(frozen=True)
class Height:
    """Metres above the start, its variance, and how many ticks told a change."""

    height_m: float = 0.0
    variance_m2: float = 0.0
    told: int = 0


class Climb(BaseFilter[Any]):
    """Adds up changes of height and reports them as diagnostics."""

    name = "climb"
    State = Height

    def start(self, prior: Any, rng: Any) -> Height:
        return Height()

    def step(self, state: Height, motion: Motion, observations: Sequence[Any], rng: Any) -> tuple[Height, Report]:
        if motion.height_change_m is not None:
            state = Height(
                state.height_m + motion.height_change_m,
                state.variance_m2 + motion.height_change_sigma_m**2,
                state.told + 1,
            )
        return state, Report(diagnostics={"height_m": state.height_m, "told": state.told})

    def estimate(self, state: Height) -> Belief:
        return Belief(floor="F1", xy=np.zeros(2), covariance=np.eye(2))


def test_a_climb_of_four_metres_is_told_to_the_filter(barometer: type[Any]) -> None:
    t_ns = np.arange(0, 40_000_000_000, 100_000_000)
    height_m = np.interp(t_ns * 1e-9, [10.0, 30.0], [0.0, 4.0])
    pressure_hpa = 1000.0 * np.exp(-height_m / 8434.0)
    events: list[Any] = [
        Pressure(t_ns=int(t), pressure_hpa=float(p), device="d") for t, p in zip(t_ns, pressure_hpa, strict=True)
    ]
    still = np.tile([0.0, 0.0, 9.81], (len(t_ns), 1))
    events += [
        motion_samples(t_ns[n : n + 5], accelerometer=still[n : n + 5], device="d") for n in range(0, len(t_ns), 5)
    ]
    pipeline = Pipeline(
        "p",
        Stage("filter", "climb", "climb", Climb(None, Context())),
        Stage("pdr", "barometer", "barometer", barometer(barometer.Params(), Context())),
    )
    recording = Recording(name="climb", floor="F1", events=tuple(events))
    replayed = replay_recording(recording, [pipeline], KernelSettings(strict=True), start=START)
    last = replayed.settled["p"][-1]
    assert last.diagnostics["height_m"] == pytest.approx(4.0, abs=0.01)
    assert last.diagnostics["told"] > 150
    at_20_s = next(e for e in replayed.settled["p"] if e.t_ns == 20_000_000_000)
    assert at_20_s.diagnostics["height_m"] == pytest.approx(2.0, abs=0.15)  # half a second of smoothing behind


def test_it_is_chosen_by_name_in_a_pipeline(install: Install) -> None:
    points = [*entry_points(group="tickfix.plugins"), *install("barometer")]
    text = '[pipelines.p]\npdr = { use = "barometer", smoothing_s = 1.0 }\nfilter = "dead-reckoning"'
    chosen = config.parse_config(text, "test", discover(points))
    (pipeline,) = config.build_pipelines(chosen.pipelines, Context(), {})
    assert pipeline.pdr is not None
    assert pipeline.pdr.algorithm.params.smoothing_s == 1.0


def test_it_keeps_the_contract_of_dead_reckoning(barometer: type[Any]) -> None:
    contract = type("Contract", (PdrContract,), {"algorithm": barometer})()
    checks = [name for name in dir(contract) if name.startswith("test_")]
    assert len(checks) > 10
    for name in checks:
        getattr(contract, name)()
    assert importlib.import_module("tickfix_barometer").TICKFIX_API == 1
