"""Signs of life of a loop and its workers: who is silent, and in which stage."""

from __future__ import annotations

import time

import pytest

from tickfix import config
from tickfix.api import Context
from tickfix.kernel import Pipeline, Stage
from tickfix.live.heartbeat import MAX_WORKERS, WatchdogHeartbeat
from tickfix.registry import discover

CONFIG = '[pipelines.k]\npdr = "steps"\nfilter = "kalman"\n'


@pytest.fixture(scope="module")
def pipeline() -> Pipeline:
    (found,) = config.build_pipelines(config.parse_config(CONFIG, "test", discover()).pipelines, Context(floors={}), {})
    return found


@pytest.fixture
def heartbeat(pipeline: Pipeline) -> WatchdogHeartbeat:
    heartbeat = WatchdogHeartbeat()
    heartbeat.register_stages([pipeline])
    return heartbeat


def pdr_of(pipeline: Pipeline) -> Stage:
    assert pipeline.pdr is not None
    return pipeline.pdr


def test_the_stage_is_that_of_the_worker_that_is_silent_for_longest(
    heartbeat: WatchdogHeartbeat, pipeline: Pipeline
) -> None:
    first, second = heartbeat.for_worker(0), heartbeat.for_worker(MAX_WORKERS - 1)
    assert heartbeat.stage is None
    first.enter_stage(pipeline.filter)
    second.enter_stage(pdr_of(pipeline))
    assert heartbeat.stage == (pipeline.filter.key, pipeline.filter.label)
    first.enter_stage(None)
    assert heartbeat.stage == (pdr_of(pipeline).key, pdr_of(pipeline).label)
    second.mark_idle()
    assert heartbeat.stage is None


def test_a_loop_that_waits_is_as_silent_as_its_most_silent_worker(
    heartbeat: WatchdogHeartbeat, pipeline: Pipeline
) -> None:
    first, second = heartbeat.for_worker(0), heartbeat.for_worker(1)
    first.enter_stage(pipeline.filter)
    second.enter_stage(pipeline.filter)
    while (stall_s := heartbeat.stall_s) < 0.3:
        second.enter_stage(pipeline.filter)
    assert heartbeat.stall_s >= stall_s, "the second one's signs do not stand in for the first one's"
    begun_s = time.monotonic()
    first.enter_stage(None)
    second.enter_stage(pipeline.filter)
    now_s = heartbeat.stall_s
    assert now_s <= time.monotonic() - begun_s + 1e-3, "both were heard just now, so the loop waits for good reason"
    first.mark_idle()
    second.mark_idle()
    assert heartbeat.stall_s >= stall_s, "nobody has anything to do, so the loop waits for nobody"
    begun_s = time.monotonic()
    heartbeat.beat()
    now_s = heartbeat.stall_s
    assert now_s <= time.monotonic() - begun_s + 1e-3


def test_another_engine_begins_without_the_signs_of_the_last_one(
    heartbeat: WatchdogHeartbeat, pipeline: Pipeline
) -> None:
    heartbeat.mark_serving()
    heartbeat.for_worker(3).enter_stage(pipeline.filter)
    heartbeat.reset()
    assert heartbeat.stage is None
    assert not heartbeat.is_serving


def test_there_are_no_more_workers_than_places(heartbeat: WatchdogHeartbeat) -> None:
    with pytest.raises(ValueError, match=f"found {MAX_WORKERS}"):
        heartbeat.for_worker(MAX_WORKERS)
