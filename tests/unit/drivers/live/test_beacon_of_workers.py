"""Signs of life of a loop and its workers: who is silent, and in which stage."""

from __future__ import annotations

import time

import pytest

from tickfix import config
from tickfix.api import Context
from tickfix.drivers.live.watchdog.beacon import WORKERS, Beacon
from tickfix.kernel import Pipeline, Stage
from tickfix.plugins import discover

CONFIG = '[pipelines.k]\npdr = "steps"\nfilter = "kalman"\n'


@pytest.fixture(scope="module")
def pipeline() -> Pipeline:
    (found,) = config.build(config.parse(CONFIG, "test", discover()).pipelines, Context(floors={}), {})
    return found


@pytest.fixture
def beacon(pipeline: Pipeline) -> Beacon:
    beacon = Beacon()
    beacon.introduce([pipeline])
    return beacon


def pdr_of(pipeline: Pipeline) -> Stage:
    assert pipeline.pdr is not None
    return pipeline.pdr


def test_the_stage_is_that_of_the_worker_that_is_silent_for_longest(beacon: Beacon, pipeline: Pipeline) -> None:
    first, second = beacon.of_worker(0), beacon.of_worker(WORKERS - 1)
    assert beacon.stage is None
    first.calling(pipeline.filter)
    second.calling(pdr_of(pipeline))
    assert beacon.stage == (pipeline.filter.key, pipeline.filter.label)
    first.calling(None)
    assert beacon.stage == (pdr_of(pipeline).key, pdr_of(pipeline).label)
    second.rest()
    assert beacon.stage is None


def test_a_loop_that_waits_is_as_silent_as_its_most_silent_worker(beacon: Beacon, pipeline: Pipeline) -> None:
    first, second = beacon.of_worker(0), beacon.of_worker(1)
    first.calling(pipeline.filter)
    second.calling(pipeline.filter)
    while (silence_s := beacon.silence_s) < 0.3:
        second.calling(pipeline.filter)
    assert beacon.silence_s >= silence_s, "the second one's signs do not stand in for the first one's"
    begun_s = time.monotonic()
    first.calling(None)
    second.calling(pipeline.filter)
    now_s = beacon.silence_s
    assert now_s <= time.monotonic() - begun_s + 1e-3, "both were heard just now, so the loop waits for good reason"
    first.rest()
    second.rest()
    assert beacon.silence_s >= silence_s, "nobody has anything to do, so the loop waits for nobody"
    begun_s = time.monotonic()
    beacon.alive()
    now_s = beacon.silence_s
    assert now_s <= time.monotonic() - begun_s + 1e-3


def test_another_engine_begins_without_the_signs_of_the_last_one(beacon: Beacon, pipeline: Pipeline) -> None:
    beacon.serving()
    beacon.of_worker(3).calling(pipeline.filter)
    beacon.begin()
    assert beacon.stage is None
    assert not beacon.serves


def test_there_are_no_more_workers_than_places(beacon: Beacon) -> None:
    with pytest.raises(ValueError, match=f"found {WORKERS}"):
        beacon.of_worker(WORKERS)
