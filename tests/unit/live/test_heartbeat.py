"""Signs of life, as a supervisor reads them at any moment."""

from __future__ import annotations

import contextlib
import os
import time
import warnings

from tickfix.kernel import Pipeline, Stage
from tickfix.live.heartbeat import MAX_WORKERS, WatchdogHeartbeat


def pipeline(name: str, *, pdr: str = "p") -> Pipeline:
    return Pipeline(name, Stage("filter", name, f"filter {name}", None), Stage("pdr", pdr, f"pdr {pdr}", None))


def test_before_an_engine_has_introduced_its_stages_none_is_called_and_it_does_not_serve() -> None:
    heartbeat = WatchdogHeartbeat()
    assert heartbeat.stage is None
    assert not heartbeat.is_serving
    assert heartbeat.pipelines_without("any") == []
    assert heartbeat.stall_s < 60


def test_the_stage_that_was_called_is_told_until_it_comes_back() -> None:
    heartbeat, slow = WatchdogHeartbeat(), pipeline("slow")
    heartbeat.register_stages([slow, pipeline("fast")])
    heartbeat.enter_stage(slow.filter)
    assert heartbeat.stage == ("filter slow", "filter 'slow'")
    heartbeat.enter_stage(None)
    assert heartbeat.stage is None
    worker = heartbeat.for_worker(MAX_WORKERS - 1)
    worker.enter_stage(slow.pdr)
    assert heartbeat.stage == ("pdr p", "pdr 'p'")


def test_pipelines_that_do_without_a_stage_are_told() -> None:
    heartbeat = WatchdogHeartbeat()
    heartbeat.register_stages([pipeline("a"), pipeline("b"), pipeline("c", pdr="other")])
    assert heartbeat.pipelines_without("filter a") == ["b", "c"]
    assert heartbeat.pipelines_without("pdr p") == ["c"]


def test_another_engine_begins_without_the_marks_of_the_one_before() -> None:
    heartbeat, slow = WatchdogHeartbeat(), pipeline("slow")
    heartbeat.register_stages([slow])
    heartbeat.for_worker(3).enter_stage(slow.filter)
    heartbeat.mark_serving()
    heartbeat.reset()
    assert heartbeat.stage is None
    assert not heartbeat.is_serving
    before_s = time.monotonic()
    heartbeat.beat()
    assert heartbeat.stall_s <= time.monotonic() - before_s + 1e-3


def test_marks_and_names_that_make_no_sense_are_no_stage() -> None:
    heartbeat, slow = WatchdogHeartbeat(), pipeline("slow")
    heartbeat.register_stages([slow])
    heartbeat.enter_stage(slow.filter)
    heartbeat._memory[1_100:] = b"\xff" * (len(heartbeat._memory) - 1_100)
    assert heartbeat.stage is None
    assert heartbeat.pipelines_without("filter slow") == []


def test_whoever_reads_while_signs_are_left_never_sees_half_of_one() -> None:
    heartbeat = WatchdogHeartbeat()
    ours, theirs = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # the child takes no lock that a thread here may hold
        pid = os.fork()
    if not pid:
        os.close(theirs)
        os.set_blocking(ours, False)
        try:
            while True:
                for _ in range(1000):
                    heartbeat.beat()
                with contextlib.suppress(BlockingIOError):
                    os.read(ours, 1)
                    break
        finally:
            os._exit(0)
    try:
        longest_s = max(heartbeat.stall_s for _ in range(100_000))
    finally:
        os.close(theirs)
        os.close(ours)
        os.waitpid(pid, 0)
    assert longest_s < 20.0
