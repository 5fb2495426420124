"""An observer of a third party watches replays; one that raises is named, removed, and changes nothing."""

from __future__ import annotations

import json
import logging
import sys
from collections.abc import Callable
from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tickfix import config
from tickfix.api import (
    BaseFilter,
    Belief,
    Context,
    EpochStart,
    Estimate,
    Fix,
    MotionSamples,
    Overrun,
    PluginError,
    Recording,
    Run,
    Samples,
    StageFault,
    Stateless,
    Status,
    hookimpl,
)
from tickfix.kernel import KernelSettings, Pipeline
from tickfix.kernel.stages import Stage
from tickfix.observers import OBSERVER_HOOKS, Observers
from tickfix.registry import Registry, discover
from tickfix.replay.driver import ReplayResult, replay_recording

Install = Callable[[str], list[EntryPoint]]
START = Fix(t_ns=0, floor="F1", xy=np.array([2.0, 3.0]), covariance=np.eye(2))
RUN = Run(id="r", mode="live", site="s", pipelines=("p",))


def walk() -> Recording:
    t_ns = np.arange(0, 20_000_000_000, 100_000_000)
    shaking = 9.81 + 3.0 * np.sin(2 * np.pi * 1.8 * t_ns * 1e-9)
    values = np.stack([np.zeros(len(t_ns)), np.zeros(len(t_ns)), shaking], axis=1)
    batches = [
        MotionSamples(sensors={"accelerometer": Samples(t_ns[n : n + 10], values[n : n + 10])}, device="d")
        for n in range(0, len(t_ns), 10)
    ]
    return Recording(name="walk", floor="F1", events=tuple(batches))


def pipelines(extra: Pipeline | None = None) -> list[Pipeline]:
    chosen = config.parse_config('[pipelines.p]\npdr = "steps"\nfilter = "dead-reckoning"', "test", discover())
    built = list(config.build_pipelines(chosen.pipelines, Context(), {}))
    return built if extra is None else [*built, extra]


class Broken(BaseFilter[Any]):
    """Fails at every tick."""

    name = "broken"
    State = Stateless

    def start(self, prior: Any, rng: Any) -> Stateless:
        return Stateless()

    def step(self, state: Any, motion: Any, observations: Any, rng: Any) -> Any:
        raise ZeroDivisionError("by nothing")

    def estimate(self, state: Any) -> Any:
        return Belief(floor="F1", xy=np.zeros(2), covariance=np.eye(2))


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text("utf-8").splitlines()]


def test_the_package_is_found_by_its_entry_point(install: Install) -> None:
    found = discover(install("observer"))
    assert found.problems == ()
    assert found.offers == ()
    assert all(found.observers.wants(hook) for hook in OBSERVER_HOOKS)


def test_it_sees_every_estimate_of_a_replay_in_batches(
    install: Install, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "log.jsonl"
    monkeypatch.setenv("WALK_LOG", str(log))
    replayed = replay_recording(
        walk(), pipelines(), start=START, observers=discover(install("observer")).observers, site="mall"
    )
    seen = lines(log)
    assert seen[0] == {"run": "walk", "mode": "replay", "what": "started", "site": "mall", "pipelines": ["p"]}
    assert seen[1] == {"run": "walk", "mode": "replay", "what": "epochs", "devices": ["d"]}
    assert seen[-1] == {"run": "walk", "mode": "replay", "what": "ended", "reason": ""}
    ticks = [tick for line in seen if line["what"] == "estimates" for tick in line["ticks"]]
    said = [[e.pipeline, e.epoch, e.tick, e.revision, str(e.status)] for e, _ in replayed.published["p"]]
    assert ticks == said
    assert 2 < sum(line["what"] == "estimates" for line in seen) < len(ticks)


def test_it_sees_faults_and_how_a_run_failed(install: Install, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = tmp_path / "log.jsonl"
    monkeypatch.setenv("WALK_LOG", str(log))
    observers = discover(install("observer")).observers
    broken = Pipeline("q", Stage("filter", "broken", "broken", Broken(None, Context())))
    replay_recording(walk(), pipelines(broken), start=START, observers=observers)
    faults = [line for line in lines(log) if line["what"] == "faults"]
    assert faults
    assert {stage for line in faults for stage in line["stages"]} == {"filter 'broken'"}

    with pytest.raises(PluginError):
        replay_recording(walk(), pipelines(broken), KernelSettings(strict=True), start=START, observers=observers)
    last = lines(log)[-1]
    assert last["what"] == "ended"
    assert last["reason"].startswith("PluginError: filter 'broken': ZeroDivisionError")


def tracks(result: ReplayResult) -> list[bytes]:
    return [e.belief.xy.tobytes() for e, _ in result.published["p"] if e.belief is not None]


@pytest.mark.parametrize("error", [ValueError("too much"), SystemExit(3)])
def test_an_observer_that_raises_is_named_once_and_removed_and_the_run_goes_on(
    error: BaseException, caplog: pytest.LogCaptureFixture
) -> None:
    seen: list[int] = []

    @hookimpl
    def raising(estimates: Any) -> None:
        raise error

    @hookimpl
    def counting(estimates: Any) -> None:
        seen.append(len(estimates))

    observers = Observers(
        {
            "bad (acme 1)": SimpleNamespace(
                tickfix_estimates=raising, tickfix_run_ended=hookimpl(lambda: seen.append(-1))
            ),
            "good": SimpleNamespace(tickfix_estimates=counting),
        }
    )
    with caplog.at_level(logging.ERROR):
        watched = replay_recording(walk(), pipelines(), start=START, observers=observers)
    assert tracks(watched) == tracks(replay_recording(walk(), pipelines(), start=START))
    assert sum(seen) == len(watched.published["p"])
    assert observers.removed == ["bad (acme 1)"]
    (record,) = caplog.records
    assert "observer bad (acme 1): tickfix_estimates raised" in record.getMessage()


def estimate(device: str, epoch: int, tick: int) -> Estimate:
    return Estimate(
        device=device, pipeline="p", epoch=epoch, tick=tick, t_ns=tick * 200_000_000, status=Status.INITIALISING
    )


def test_an_epoch_is_reported_once_before_its_first_estimates() -> None:
    calls: list[Any] = []
    observers = Observers(
        {
            "o": SimpleNamespace(
                tickfix_epochs_started=hookimpl(lambda epochs: calls.extend([epochs])),
                tickfix_estimates=hookimpl(lambda estimates: calls.append([e.tick for e in estimates])),
            )
        }
    )
    observers.run_started(RUN)
    observers.estimates(RUN, [estimate("a", 0, 1), estimate("b", 0, 1)])
    observers.estimates(RUN, [estimate("a", 0, 2)])
    observers.estimates(RUN, [estimate("a", 1, 3)])
    assert calls == [
        (EpochStart(device="a", epoch=0, t_ns=200_000_000), EpochStart(device="b", epoch=0, t_ns=200_000_000)),
        [1, 1],
        [2],
        (EpochStart(device="a", epoch=1, t_ns=600_000_000),),
        [3],
    ]


CALLS = {
    "tickfix_run_started": lambda o: o.run_started(RUN),
    "tickfix_epochs_started": lambda o: o.estimates(RUN, [estimate("a", 0, 1)]),
    "tickfix_estimates": lambda o: o.estimates(RUN, [estimate("a", 0, 1)]),
    "tickfix_fixes": lambda o: o.fixes(RUN, [START]),
    "tickfix_faults": lambda o: o.faults(RUN, [StageFault(stage="filter 'x'", error="E", detail="d")]),
    "tickfix_overruns": lambda o: o.overruns(RUN, [Overrun(active=True, lag_s=2.0, devices=3)]),
    "tickfix_run_ended": lambda o: o.run_ended(RUN, "why"),
}


@pytest.mark.parametrize("hook", OBSERVER_HOOKS)
def test_every_observer_hook_is_called_through_pluggy(hook: str) -> None:
    calls: list[Any] = []
    observers = Observers({"o": SimpleNamespace(**{hook: hookimpl(lambda run: calls.extend([run]))})})
    CALLS[hook](observers)
    assert calls == [RUN]
    assert [name for name in OBSERVER_HOOKS if observers.wants(name)] == [hook]


def test_an_observer_with_an_argument_that_is_not_specified_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    module = SimpleNamespace(tickfix_estimates=hookimpl(lambda estimate: None))
    monkeypatch.setitem(sys.modules, "tf_odd", module)
    found: Registry = discover([EntryPoint("odd", "tf_odd", "tickfix.plugins")])
    (problem,) = found.problems
    assert "estimate" in problem.problem
    assert not found.observers
