"""The garbage collector seldom stops the loop, and what is over is freed without it."""

from __future__ import annotations

import gc
import weakref

import numpy as np

from tickfix import config
from tickfix.api import Context, MotionSamples, Samples
from tickfix.kernel import Kernel, KernelSettings
from tickfix.live.startup import rare_full_collections
from tickfix.registry import discover

CONFIG = '[pipelines.k]\npdr = "steps"\nfilter = "kalman"\n'


def test_full_collections_are_rare_within_and_as_before_after() -> None:
    before = gc.get_threshold()
    with rare_full_collections():
        assert gc.get_threshold()[:2] == before[:2]
        assert gc.get_threshold()[2] >= 100 * before[2]
        assert gc.get_freeze_count() > 0
    assert gc.get_threshold() == before
    assert gc.get_freeze_count() == 0


def test_a_device_that_is_gone_leaves_nothing_for_the_collector() -> None:
    pipelines = config.build_pipelines(
        config.parse_config(CONFIG, "test", discover()).pipelines, Context(floors={}), {}
    )
    kernel = Kernel(pipelines, KernelSettings(strict=True))
    t_ns = 200_000_000 + 20_000_000 * np.arange(100)
    gc.disable()
    try:
        kernel.feed(MotionSamples(sensors={"accelerometer": Samples(t_ns, np.ones((100, 3)))}, device="d"))
        assert kernel.run("d").published
        epoch = weakref.ref(kernel._devices["d"]._epoch)
        assert epoch() is not None
        assert kernel.finish("d").settled
        assert epoch() is None
    finally:
        gc.enable()
