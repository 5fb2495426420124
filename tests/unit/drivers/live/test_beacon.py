"""Signs of life, as a supervisor reads them at any moment."""

from __future__ import annotations

import contextlib
import os
import time
import warnings

from tickfix.drivers.live.watchdog.beacon import WORKERS, Beacon
from tickfix.kernel import Pipeline, Stage


def pipeline(name: str, *, pdr: str = "p") -> Pipeline:
    return Pipeline(name, Stage("filter", name, f"filter {name}", None), Stage("pdr", pdr, f"pdr {pdr}", None))


def test_before_an_engine_has_introduced_its_stages_none_is_called_and_it_does_not_serve() -> None:
    beacon = Beacon()
    assert beacon.stage is None
    assert not beacon.serves
    assert beacon.without("any") == []
    assert beacon.silence_s < 60


def test_the_stage_that_was_called_is_told_until_it_comes_back() -> None:
    beacon, slow = Beacon(), pipeline("slow")
    beacon.introduce([slow, pipeline("fast")])
    beacon.calling(slow.filter)
    assert beacon.stage == ("filter slow", "filter 'slow'")
    beacon.calling(None)
    assert beacon.stage is None
    worker = beacon.of_worker(WORKERS - 1)
    worker.calling(slow.pdr)
    assert beacon.stage == ("pdr p", "pdr 'p'")


def test_pipelines_that_do_without_a_stage_are_told() -> None:
    beacon = Beacon()
    beacon.introduce([pipeline("a"), pipeline("b"), pipeline("c", pdr="other")])
    assert beacon.without("filter a") == ["b", "c"]
    assert beacon.without("pdr p") == ["c"]


def test_another_engine_begins_without_the_marks_of_the_one_before() -> None:
    beacon, slow = Beacon(), pipeline("slow")
    beacon.introduce([slow])
    beacon.of_worker(3).calling(slow.filter)
    beacon.serving()
    beacon.begin()
    assert beacon.stage is None
    assert not beacon.serves
    before_s = time.monotonic()
    beacon.alive()
    assert beacon.silence_s <= time.monotonic() - before_s + 1e-3


def test_marks_and_names_that_make_no_sense_are_no_stage() -> None:
    beacon, slow = Beacon(), pipeline("slow")
    beacon.introduce([slow])
    beacon.calling(slow.filter)
    beacon._memory[1_100:] = b"\xff" * (len(beacon._memory) - 1_100)
    assert beacon.stage is None
    assert beacon.without("filter slow") == []


def test_whoever_reads_while_signs_are_left_never_sees_half_of_one() -> None:
    beacon = Beacon()
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
                    beacon.alive()
                with contextlib.suppress(BlockingIOError):
                    os.read(ours, 1)
                    break
        finally:
            os._exit(0)
    try:
        longest_s = max(beacon.silence_s for _ in range(100_000))
    finally:
        os.close(theirs)
        os.close(ours)
        os.waitpid(pid, 0)
    assert longest_s < 20.0
