"""Steps of pdr and fingerprint of many devices as one batch: the same results, fewer calls."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from tickfix.api import (
    TICK_NS,
    Belief,
    Event,
    Fix,
    Motion,
    MotionSamples,
    Observation,
    Prior,
    Readings,
    Report,
    Rng,
    Scan,
    Window,
    motion_samples,
)
from tickfix.kernel import Kernel, KernelOutput, KernelSettings, KernelSnapshot, Pipeline, Stage

T0 = 50 * TICK_NS
DEVICES = ("a", "b", "c")


@dataclass(frozen=True, slots=True)
class Total:
    value: float = 0.0


class Walker:
    """Adds up what is measured, and fails for values as they are set: ``one`` of each step, ``batch`` of all."""

    State = Total

    def __init__(self, one: str = "") -> None:
        self.singles = 0
        self._one = one

    def start(self) -> Total:
        return Total()

    def step(self, state: Total, samples: MotionSamples) -> tuple[Total, Motion]:
        self.singles += 1
        return self._stepped(state, samples)

    def _stepped(self, state: Total, samples: MotionSamples) -> tuple[Total, Motion]:
        measured = samples.sensors.get("accelerometer")
        way = 0.0 if measured is None else float(measured.values[:, 0].sum())
        if self._one == "raises" and way == 2.0:
            raise RuntimeError("not this one")
        total = Total(float("nan") if self._one == "nan" and way == 2.0 else state.value + way)
        motion = Motion(t0_ns=samples.t0_ns, t1_ns=samples.t1_ns, distance_m=way, travelled_m=state.value + way)
        return total, motion


class BatchedWalker(Walker):
    def __init__(self, one: str = "", batch: str = "") -> None:
        super().__init__(one)
        self.batches: list[int] = []
        self._batch = batch

    def step_many(self, states: Sequence[Total], samples: Sequence[MotionSamples]) -> list[tuple[Total, Motion]]:
        self.batches.append(len(states))
        if self._batch == "raises":
            raise RuntimeError("not together")
        stepped = [self._stepped(*each) for each in zip(states, samples, strict=True)]
        if self._batch == "nan":
            stepped[0] = Total(float("nan")), stepped[0][1]
        return stepped[1:] if self._batch == "short" else stepped


class Locator:
    """Counts scans, and finds a place that depends on how many there were."""

    State = Total
    window = Window()

    def start(self) -> Total:
        return Total()

    def step(self, state: Total, window: Readings) -> tuple[Total, Observation]:
        after = Total(state.value + 1.0 + 0.1 * len(window))
        fix = Fix(
            t_ns=window.t_ns, floor="F", xy=np.array([after.value, float(window.rssi_dbm[0])]), covariance=np.eye(2)
        )
        return after, Observation(t_ns=window.t_ns, source="locator", fix=fix)


class BatchedLocator(Locator):
    def __init__(self, batch: str = "") -> None:
        self.batches: list[int] = []
        self._batch = batch

    def step_many(self, states: Sequence[Total], windows: Sequence[Readings]) -> list[tuple[Total, Observation]]:
        self.batches.append(len(states))
        stepped = [self.step(*each) for each in zip(states, windows, strict=True)]
        if self._batch == "late":
            late = Fix(t_ns=10**15, floor="F", xy=np.zeros(2), covariance=np.eye(2))
            stepped[0] = stepped[0][0], Observation(t_ns=windows[0].t_ns, source="locator", fix=late)
        return stepped


class Adder:
    """A filter that adds up motions and fixes."""

    State = Total

    def __init__(self) -> None:
        self.batches: list[int] = []

    def start(self, prior: Prior, rng: Rng) -> Total:
        return Total()

    def step(self, state: Total, motion: Motion, seen: Sequence[Observation], rng: Rng) -> tuple[Total, Report]:
        fixes = sum(float(o.fix.xy.sum()) for o in seen if o.fix is not None)
        return Total(state.value + motion.distance_m + fixes + float(rng.random())), Report(used=len(seen))

    def step_many(self, *columns: Sequence[Any]) -> list[tuple[Total, Report]]:
        self.batches.append(len(columns[0]))
        return [self.step(*each) for each in zip(*columns, strict=True)]

    def estimate(self, state: Total) -> Belief:
        return Belief(floor="F", xy=np.array([state.value, 0.0]), covariance=np.eye(2))

    def estimate_many(self, states: Sequence[Total]) -> list[Belief]:
        return [self.estimate(state) for state in states]


def kernel_of(pdr: Any, fingerprint: Any, adder: Any) -> Kernel:
    stages = Stage("filter", "f", "filter", adder), Stage("pdr", "p", "pdr", pdr)
    return Kernel([Pipeline("x", *stages, Stage("fingerprint", "s", "fingerprint", fingerprint))], KernelSettings())


def events(first: int, last: int) -> Iterator[Event]:
    """Yield samples of every device in every tick, and scans of ever other devices in some."""
    for k in range(first, last):
        for n, device in enumerate(DEVICES):
            t_ns = T0 + k * TICK_NS + 1
            yield motion_samples([t_ns], accelerometer=[[1.0 + n, 0.0, 0.0]], device=device)
            if (k + n) % 3 or k % 4 == 0:
                yield scan(device, t_ns, -50.0 - n - k)


def scan(device: str, t_ns: int, rssi_dbm: float) -> Scan:
    return Scan(transmitters=("t",), rssi_dbm=[rssi_dbm], heard_ns=[t_ns], t_ns=t_ns, device=device)


def run(kernel: Kernel, last: int, first: int = 0) -> list[KernelOutput]:
    for event in events(first, last):
        kernel.feed(event)
    return kernel.run_many([(device, T0 // TICK_NS + last) for device in DEVICES])


def said(outputs: Sequence[KernelOutput]) -> list[Any]:
    return [
        [(e.tick, e.revision, e.failed_by, None if e.belief is None else e.belief.xy.tolist()) for e in estimates]
        for output in outputs
        for estimates in (output.published, output.revised, output.settled)
    ]


def test_all_devices_are_stepped_together_and_no_result_changes() -> None:
    walker, locator, adder = BatchedWalker(), BatchedLocator(), Adder()
    kernel, expected = kernel_of(walker, locator, adder), kernel_of(Walker(), Locator(), Adder())
    assert said(run(kernel, 8)) == said(run(expected, 8))
    assert walker.singles == 0
    assert set(walker.batches) == {3}
    assert set(locator.batches) == {2, 3}
    assert set(adder.batches) == {3}  # devices without a scan waited for those with one
    for one in (kernel, expected):  # a late scan is folded again, from its tick on
        one.feed(scan("b", T0 + 3 * TICK_NS + 7, -40.0))
    found = said(run(kernel, 10, first=8))
    assert found == said(run(expected, 10, first=8))
    assert any(revision for estimates in found for _, revision, _, _ in estimates)


def test_a_device_alone_is_stepped_alone() -> None:
    walker, locator = BatchedWalker(), BatchedLocator()
    kernel = kernel_of(walker, locator, Adder())
    for event in events(0, 4):
        kernel.feed(event)
        if event.device == "b":
            kernel.run("b")
    kernel.finish("b")
    assert walker.singles > 0
    assert walker.batches == locator.batches == []


@pytest.mark.parametrize("batch", ["raises", "nan", "short"])
def test_where_a_batch_of_a_pdr_fails_each_device_is_stepped_alone(batch: str) -> None:
    walker = BatchedWalker(batch=batch)
    kernel = kernel_of(walker, Locator(), Adder())
    assert said(run(kernel, 6)) == said(run(kernel_of(Walker(), Locator(), Adder()), 6))
    assert walker.singles == sum(walker.batches) > 0
    assert not kernel.failures


def test_where_a_batch_of_a_fingerprint_fails_its_check_each_device_is_stepped_alone() -> None:
    locator = BatchedLocator(batch="late")
    kernel = kernel_of(Walker(), locator, Adder())
    assert said(run(kernel, 6)) == said(run(kernel_of(Walker(), Locator(), Adder()), 6))
    assert locator.batches
    assert not kernel.failures


@pytest.mark.parametrize(("one", "error"), [("raises", "RuntimeError"), ("nan", "FloatingPointError")])
def test_a_step_that_fails_fails_for_its_device_alone(one: str, error: str) -> None:
    kernel, expected = (kernel_of(w, Locator(), Adder()) for w in (BatchedWalker(one), Walker(one)))
    outputs = run(kernel, 6)
    assert said(outputs) == said(run(expected, 6))
    failed = [{e.failed_by for e in output.published if e.failed_by} for output in outputs]
    assert failed == [set(), {f"pdr 'p': {error}"}, set()]
    assert kernel.failures == expected.failures


def test_a_restored_kernel_steps_together_and_goes_on_as_it_would_have() -> None:
    kernel, walker = kernel_of(BatchedWalker(), BatchedLocator(), Adder()), BatchedWalker()
    run(kernel, 6)
    kept = kernel.snapshot().packed()
    unbatched = kernel_of(Walker(), Locator(), Adder())
    run(unbatched, 6)
    assert unbatched.snapshot().packed() == kept
    restored = kernel_of(walker, BatchedLocator(), Adder())
    restored.restore(KernelSnapshot.unpacked(kept))
    assert set(walker.batches) == {3}
    assert said(run(restored, 9, first=6)) == said(run(kernel, 9, first=6))
