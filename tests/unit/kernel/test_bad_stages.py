"""What stages may do wrong, and that it harms nobody else."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from lab import fold
from streams import SETTINGS, T0, run, sample, scan, walk
from toys import Chain, ToyFilter, ToyFingerprint, toy_pipeline

from tickfix.api import TICK_NS, Belief, Fix, Motion, Observation, PluginError, Prior, Readings, Report, Rng, Window
from tickfix.kernel import Kernel, KernelSnapshot, Stage

LENIENT = replace(SETTINGS, strict=False)


class WordlessError(RuntimeError):
    def __str__(self) -> str:
        raise RuntimeError("no words")


def leaves() -> None:
    raise SystemExit(3)


def wordless() -> None:
    raise WordlessError


BAD_STEPS: dict[str, Callable[[Chain, Any], tuple[Any, Any]]] = {
    "SystemExit": lambda state, report: (leaves(), report),
    "WordlessError": lambda state, report: (wordless(), report),
    "TypeError of reasons": lambda state, _: (state, Report(reasons=(object(),))),  # type: ignore[arg-type]
    "TypeError of a list": lambda state, _: (state, Report(reasons=["a"])),  # type: ignore[arg-type]
    "TypeError of lost": lambda state, _: (state, Report(lost=np.array([True, False]))),  # type: ignore[arg-type]
    "TypeError of used": lambda state, _: (state, Report(used="many")),  # type: ignore[arg-type]
    "TypeError of diagnostics": lambda state, _: (state, Report(diagnostics=[1.0])),  # type: ignore[arg-type]
    "ValueError of a name": lambda state, _: (state, Report(diagnostics={"Effective size": 1.0})),
    "ValueError of many": lambda state, _: (state, Report(diagnostics={f"d{n}": 1.0 for n in range(65)})),
    "ValueError of many words": lambda state, _: (state, Report(reasons=("a" * 5_000,))),
}


@pytest.mark.parametrize("fault", BAD_STEPS)
def test_whatever_a_step_returns_or_raises_fails_by_name_and_leaves_the_others_alone(fault: str) -> None:
    class Bad(ToyFilter):
        def step(self, state: Chain, motion: Motion, observations: Sequence[Observation], rng: Rng) -> Any:
            return BAD_STEPS[fault](*super().step(state, motion, observations, rng))

    fails(Stage("filter", "bad", "bad", Bad()), f"filter 'bad': {fault.partition(' ')[0]}")


@pytest.mark.parametrize(
    "belief",
    [
        Belief(floor=4, xy=np.zeros(2), covariance=np.eye(2)),  # type: ignore[arg-type]
        Belief(floor="F", xy=np.zeros(2), covariance=np.eye(2), floor_probabilities=((4, 1.0),)),  # type: ignore[arg-type]
    ],
)
def test_a_floor_that_is_no_name_fails(belief: Belief) -> None:
    class Bad(ToyFilter):
        def estimate(self, state: Chain) -> Belief:
            return belief

    fails(Stage("filter", "bad", "bad", Bad()), "filter 'bad': TypeError")


@pytest.mark.parametrize("t_ns", [math.nan, "now", None, np.array([1, 2])])
def test_a_fix_whose_time_is_no_number_fails(t_ns: Any) -> None:
    class Bad(ToyFingerprint):
        def step(self, state: Chain, window: Readings) -> tuple[Chain, Observation]:
            state, observation = super().step(state, window)
            return state, replace(observation, fix=Fix(t_ns=t_ns, floor="F", xy=np.zeros(2)))

    stage = Stage("fingerprint", "bad", "bad", Bad(Window()))
    events = [scan(0.5, "a"), *walk(0, 2)]
    folded = fold([toy_pipeline(), replace(toy_pipeline("bad"), fingerprint=stage)], events, LENIENT)
    assert {e.failed_by for e in folded.settled["d", "bad"]} - {""} <= {
        "fingerprint 'bad': TypeError",
        "fingerprint 'bad': ValueError",
    }
    assert folded.failures
    assert folded.settled_as("d", "toy") == run(events).settled_as("d", "toy")


def test_a_state_that_cannot_be_packed_is_left_out_of_the_snapshot_and_the_others_go_on() -> None:
    @dataclass(frozen=True)
    class Unpackable:
        chain: Chain
        extra: object

    class Bad(ToyFilter):
        State = Unpackable  # type: ignore[assignment]

        def start(self, prior: Prior, rng: Rng) -> Any:
            begun = super().start(prior, rng)
            return None if begun is None else Unpackable(begun, {"a": 1})

        def step(self, state: Any, motion: Motion, observations: Sequence[Observation], rng: Rng) -> Any:
            chain, report = super().step(state.chain, motion, observations, rng)
            return Unpackable(chain, {"a": 1}), report

        def estimate(self, state: Any) -> Belief:
            return super().estimate(state.chain)

    pipelines = [toy_pipeline(), replace(toy_pipeline("bad"), filter=Stage("filter", "bad", "bad", Bad()))]
    kernel, again = Kernel(pipelines, LENIENT), Kernel(pipelines, LENIENT)
    for event in [scan(0.5, "a"), *walk(0, 14)]:
        kernel.feed(event)
        kernel.run("d")
    again.restore(KernelSnapshot.unpacked(kernel.snapshot().packed()))
    assert kernel.failures == {"filter 'bad': TypeError": 1}
    said = []
    for one in (kernel, again):
        for event in walk(14, 16):
            one.feed(event)
        said.append([e.belief.xy.tolist() for e in one.run("d").published if e.pipeline == "toy" and e.belief])
    assert said[0] == said[1] != []


def fails(stage: Stage, failure: str) -> None:
    events = [scan(0.5, "a"), *walk(0, 2)]
    folded = fold([toy_pipeline(), replace(toy_pipeline("bad"), filter=stage)], events, LENIENT)
    assert {e.failed_by for e in folded.settled["d", "bad"]} - {""} == {failure}
    assert folded.settled_as("d", "toy") == run(events).settled_as("d", "toy")
    with pytest.raises(PluginError, match="filter 'bad'"):
        fold([replace(toy_pipeline("bad"), filter=stage)], events, SETTINGS)


def test_between_calls_no_stage_is_being_called() -> None:
    called: list[Stage | None] = []
    kernel = Kernel([toy_pipeline()], on_call=called.append)
    kernel.feed(sample(0.1))
    kernel.run("d", T0 // TICK_NS + 1)
    assert len(called) > 2
    assert all(stage is not None for stage in called[::2])
    assert set(called[1::2]) == {None}


def test_diagnostics_reach_the_estimate_read_only_and_without_what_is_not_finite() -> None:
    class Telling(ToyFilter):
        def step(self, state: Chain, motion: Motion, observations: Sequence[Observation], rng: Rng) -> Any:
            state, report = super().step(state, motion, observations, rng)
            return state, replace(report, diagnostics={"nis": 2, "ess": np.float64(81.5), "bad": math.inf})

    stage = Stage("filter", "telling", "telling", Telling())
    events = [scan(0.5, "a"), *walk(0, 2)]
    estimates = fold([replace(toy_pipeline("p"), filter=stage)], events, SETTINGS).published["d", "p"]
    told = [estimate.diagnostics for estimate in estimates if estimate.diagnostics]
    assert told
    assert all(list(one.items()) == [("ess", 81.5), ("nis", 2.0)] for one in told)
    with pytest.raises(TypeError):
        told[0]["ess"] = 0.0  # type: ignore[index]
