"""What is asked of a fingerprint beforehand is what the kernel asks later: nothing is left to compute in the loop."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lab import examples, track_digest
from toys import toy_pipeline

from tickfix.api import Event, MotionSamples, Readings, Samples, Scan, Window
from tickfix.kernel import Kernel, KernelSettings
from tickfix.live.localization import LocalizationResult, LocatorThreads, with_fingerprint_cache

MS = 1_000_000
PATIENCE_S = 60.0
T0 = 5_000_000_000_000
SETTINGS = KernelSettings(horizon_s=4.0, strict=True)
PLAIN = (
    toy_pipeline("toy"),
    toy_pipeline("redated", redated=True),
    toy_pipeline("short", window=Window(seconds=2.0, scans=2, sources=("wifi",))),
)


class Counting:
    """Counts the steps of an algorithm by thread."""

    def __init__(self, algorithm: Any) -> None:
        self._algorithm = algorithm
        self.State, self.window, self.start = algorithm.State, algorithm.window, algorithm.start
        self.steps: list[int] = []

    def step(self, state: Any, window: Readings) -> Any:
        self.steps.append(threading.get_ident())
        return self._algorithm.step(state, window)


def scan(t_ms: int, source: str) -> Scan:
    t_ns = T0 + MS * t_ms
    heard = np.array([t_ns - 700 * MS, t_ns])
    rssi = np.array([-50.0, -60.0 - t_ms % 7])
    return Scan(transmitters=("a", "b"), rssi_dbm=rssi, heard_ns=heard, t_ns=t_ns, source=source, device="d")


def motion(t_ms: int) -> MotionSamples:
    return MotionSamples(
        sensors={"gyroscope": Samples(np.array([T0 + MS * t_ms]), np.full((1, 3), float(t_ms % 5)))}, device="d"
    )


@examples(40)
@given(
    order=st.permutations(range(24)),
    late=st.lists(st.integers(0, 3), min_size=24, max_size=24),
    sources=st.lists(st.sampled_from(["wifi", "ble"]), min_size=24, max_size=24),
)
def test_the_loop_never_waits_for_a_scan_that_was_located_beside_it(
    order: list[int], late: list[int], sources: list[str]
) -> None:
    events: list[Event] = [motion(250 * n) for n in range(24)]
    events += [scan(250 * n, sources[n]) for n in order[:12]]
    events.sort(key=lambda e: (e.t_ns + 900 * MS * late[(e.t_ns - T0) // (250 * MS)], isinstance(e, Scan)))
    counting = [Counting(p.fingerprint.algorithm) for p in PLAIN if p.fingerprint is not None]
    watched = with_fingerprint_cache(
        [
            type(p)(p.name, p.filter, p.pdr, type(p.fingerprint)("fingerprint", "toy", p.fingerprint.key, c))
            for p, c in zip(PLAIN, counting, strict=True)
            if p.fingerprint is not None
        ]
    )
    beside, plain = Kernel(watched, SETTINGS), Kernel(PLAIN, SETTINGS)
    settled: dict[str, list[Any]] = {"beside": [], "plain": []}
    for event in events:
        if isinstance(event, Scan):
            for fingerprint_request in beside.fingerprint_requests(event):
                state = fingerprint_request.state
                for window in fingerprint_request.windows:
                    state, _ = fingerprint_request.stage.algorithm.step(state, window)
        asked = sum(len(c.steps) for c in counting)
        for name, kernel in (("beside", beside), ("plain", plain)):
            kernel.feed(event)
            settled[name] += kernel.run("d").settled
        assert sum(len(c.steps) for c in counting) == asked, "the loop had to compute"
    settled["beside"] += beside.finish("d").settled
    settled["plain"] += plain.finish("d").settled
    for pipeline in PLAIN:
        one, other = ([e for e in settled[name] if e.pipeline == pipeline.name] for name in settled)
        assert track_digest(one) == track_digest(other)


def test_a_thread_that_hangs_is_left_behind_and_others_go_on() -> None:
    woken, begun, stuck = threading.Event(), threading.Event(), threading.Event()

    class Stuck:
        State = PLAIN[0].fingerprint.algorithm.State  # type: ignore[union-attr]
        window = Window()

        def start(self) -> Any:
            return self.State()

        def step(self, state: Any, window: Readings) -> Any:
            if window.t_ns == T0:
                begun.set()
                stuck.wait()
            return PLAIN[0].fingerprint.algorithm.step(state, window)  # type: ignore[union-attr]

    fingerprint = PLAIN[0].fingerprint
    assert fingerprint is not None
    (pipeline,) = with_fingerprint_cache(
        [type(PLAIN[0])("p", PLAIN[0].filter, None, type(fingerprint)("fingerprint", "s", "s", Stuck()))]
    )
    kernel = Kernel([pipeline], SETTINGS)
    now_ns = [0]
    locator = LocatorThreads(kernel.fingerprint_requests, woken.set, timeout_s=1.0, clock_ns=lambda: now_ns[0])
    for number, t_ms in enumerate((0, 1000), 1):
        locator.submit(number, scan(t_ms, "wifi"))
    assert begun.wait(PATIENCE_S)
    assert locator.results() == []
    now_ns[0] = 1_500 * MS
    results: list[LocalizationResult] = locator.results()
    assert woken.wait(PATIENCE_S)
    results += locator.results()
    assert {(d.number, bool(d.reason)) for d in results} == {(1, True), (2, False)}
    assert locator.hung == 1
    assert locator.waiting == 0
    stuck.set()
    locator.stop()


@pytest.mark.parametrize("error", [ValueError("no"), RuntimeError("never")])
def test_what_a_fingerprint_raises_is_raised_again_where_the_kernel_asks(error: Exception) -> None:
    class Failing:
        State = PLAIN[0].fingerprint.algorithm.State  # type: ignore[union-attr]
        window = Window()
        calls = 0

        def start(self) -> Any:
            return self.State()

        def step(self, state: Any, window: Readings) -> Any:
            type(self).calls += 1
            raise error

    fingerprint = PLAIN[0].fingerprint
    assert fingerprint is not None
    (pipeline,) = with_fingerprint_cache(
        [type(PLAIN[0])("p", PLAIN[0].filter, None, type(fingerprint)("fingerprint", "f", "f", Failing()))]
    )
    kernel = Kernel([pipeline], KernelSettings())
    for fingerprint_request in kernel.fingerprint_requests(scan(0, "wifi")):
        with pytest.raises(type(error)):
            fingerprint_request.stage.algorithm.step(fingerprint_request.state, fingerprint_request.windows[0])
    kernel.feed(scan(0, "wifi"))
    (estimate,) = kernel.finish("d").published
    assert estimate.failed_by == f"fingerprint 'f': {type(error).__name__}"
    assert Failing.calls == 1
