"""Filter steps of many devices as one batch: who is asked, and who fails."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from tickfix.api import TICK_NS, Belief, Fix, Motion, Observation, PluginError, Prior, Report, Rng, Status
from tickfix.kernel import Kernel, KernelSettings, KernelSnapshot, Pipeline, Stage

T0 = 50 * TICK_NS
DEVICES = ("a", "b", "c")


@dataclass(frozen=True, slots=True)
class Count:
    ticks: float = 0.0
    device: float = 0.0


class Counter:
    """Counts its ticks; remembers how many devices it was asked for at once."""

    State = Count

    def __init__(self, *, batch: str = "", one: str = "") -> None:
        self.batches: list[int] = []
        self.singles = 0
        self._batch, self._one = batch, one

    def start(self, prior: Prior, rng: Rng) -> Count | None:
        return None if prior.fix is None else Count(0.0, float(prior.fix.xy[0]))

    def step(self, state: Count, motion: Motion, seen: Sequence[Observation], rng: Rng) -> tuple[Count, Report]:
        self.singles += 1
        if self._one == "raises" and state.device == 1.0:
            raise RuntimeError("not this one")
        return self._stepped(state, rng, self._one), Report()

    def step_many(
        self,
        states: Sequence[Count],
        motions: Sequence[Motion],
        seen: Sequence[Sequence[Observation]],
        rngs: Sequence[Rng],
    ) -> list[tuple[Count, Report]]:
        assert len(states) == len(motions) == len(seen) == len(rngs)
        self.batches.append(len(states))
        stepped = [
            (self._stepped(state, rng, self._batch or self._one), Report())
            for state, rng in zip(states, rngs, strict=True)
        ]
        if self._batch == "raises":
            raise RuntimeError("not at once")
        return stepped[1:] if self._batch == "short" else stepped

    def estimate(self, state: Count) -> Belief:
        return Belief(floor="F", xy=np.array([state.ticks, state.device]), covariance=np.eye(2))

    def estimate_many(self, states: Sequence[Count]) -> list[Belief]:
        return [self.estimate(state) for state in states]

    def _stepped(self, state: Count, rng: Rng, what: str) -> Count:
        drawn = float(rng.random())
        return Count(float("nan") if what == "nan" and state.device == 1.0 else state.ticks + drawn, state.device)


def kernel_of(counter: Any, **settings: bool) -> Kernel:
    return Kernel([Pipeline("p", Stage("filter", "counter", "counter", counter))], KernelSettings(**settings))


def begun(kernel: Kernel) -> Kernel:
    for n, device in enumerate(DEVICES):
        kernel.feed(Fix(t_ns=T0, floor="F", xy=np.array([float(n), 0.0]), covariance=np.eye(2), device=device))
    kernel.run_many([(device, T0 // TICK_NS) for device in DEVICES])
    return kernel


def ticks(kernel: Kernel, upto: int, devices: Sequence[str] = DEVICES) -> dict[str, Any]:
    outputs = kernel.run_many([(device, T0 // TICK_NS + upto) for device in devices])
    return {device: output.published for device, output in zip(devices, outputs, strict=True)}


def test_devices_are_stepped_at_once_for_as_long_as_they_have_ticks_to_fold() -> None:
    counter = Counter()
    kernel = begun(kernel_of(counter))
    ticks(kernel, 2, ["a"])
    counter.batches.clear()
    counter.singles = 0
    ticks(kernel, 4)
    assert counter.batches == [3, 3, 2, 2]  # a has two ticks to fold, the others four
    assert counter.singles == 0


@pytest.mark.parametrize("batch", ["raises", "nan", "short"])
def test_where_the_batch_fails_all_are_stepped_one_by_one_as_if_it_had_not_been(batch: str) -> None:
    expected = ticks(begun(kernel_of(Counter())), 3)
    counter = Counter(batch=batch)
    said = ticks(begun(kernel_of(counter)), 3)
    assert counter.batches
    assert counter.singles == 3 * len(DEVICES)
    for device in DEVICES:
        assert [e.status for e in said[device]] == [Status.TRACKING] * 3
        assert [e.belief.xy.tolist() for e in said[device]] == [e.belief.xy.tolist() for e in expected[device]]


@pytest.mark.parametrize(("one", "error"), [("raises", "RuntimeError"), ("nan", "FloatingPointError")])
def test_a_step_that_fails_fails_for_its_device_alone(one: str, error: str) -> None:
    expected = ticks(begun(kernel_of(Counter())), 3)
    kernel = begun(kernel_of(Counter(batch="raises", one=one)))
    said = ticks(kernel, 3)
    assert [e.failed_by for e in said["b"]] == [f"filter 'counter': {error}"] * 3
    for device in ("a", "c"):
        assert [e.belief.xy.tolist() for e in said[device]] == [e.belief.xy.tolist() for e in expected[device]]
    assert kernel.failures == {f"filter 'counter': {error}": 3}


def test_a_strict_kernel_raises_what_a_device_alone_raises() -> None:
    kernel = begun(kernel_of(Counter(batch="raises", one="raises"), strict=True))
    with pytest.raises(PluginError, match="not this one"):
        ticks(kernel, 1)


def test_a_device_that_is_not_followed_says_nothing_beside_others() -> None:
    kernel = begun(kernel_of(Counter()))
    outputs = kernel.run_many([("nobody", 100), ("a", T0 // TICK_NS + 1)])
    assert not outputs[0].published
    assert len(outputs[1].published) == 1


def test_devices_are_restored_side_by_side_and_go_on_as_they_would_have() -> None:
    kernel = begun(kernel_of(Counter()))
    ticks(kernel, 4)
    counter = Counter()
    restored = kernel_of(counter)
    restored.restore(KernelSnapshot.unpacked(kernel.snapshot().packed()))
    assert counter.batches == [3, 3, 3, 3]
    assert counter.singles == 0
    said, expected = ticks(restored, 6), ticks(kernel, 6)
    for device in DEVICES:
        assert len(said[device]) == 2
        assert [e.belief.xy.tolist() for e in said[device]] == [e.belief.xy.tolist() for e in expected[device]]


def test_what_breaks_when_a_device_is_restored_is_told() -> None:
    kernel = begun(kernel_of(Counter()))
    ticks(kernel, 4)
    with pytest.raises(PluginError, match="RuntimeError: not this one"):
        kernel_of(Counter(batch="raises", one="raises"), strict=True).restore(kernel.snapshot())
