"""What algorithms are given of the world: the site to work on, and a survey to learn from."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np

from tickfix.api import Context, Floor, FloorMap, MotionSamples, Samples, Survey, SurveyWalk, Truth
from tickfix.testing.world.phone import SENSORS, samples
from tickfix.testing.world.plan import floors
from tickfix.testing.world.radio import radio_map, scan
from tickfix.testing.world.walks import T0_NS, place


def context(
    *, maps: Mapping[str, FloorMap] | None = None, fingerprint: Any = None, floor: Floor | None = None
) -> Context:
    """Return the site; without maps, unless some are given."""
    maps = MappingProxyType({}) if maps is None else maps
    return Context(floors=floors(), floor=floor, radio_map=radio_map(), maps=maps, fingerprint=fingerprint)


@cache
def survey() -> Survey:
    """Return a survey of eight short walks, for algorithms that learn."""
    walks = []
    for n in range(8):
        seconds = 20
        parts = [samples(k + 100 * n) for k in range(1, 5 * seconds + 1)]
        merged = {
            name: Samples(
                np.concatenate([p.sensors[name].t_ns for p in parts]),
                np.concatenate([p.sensors[name].values for p in parts]),
            )
            for name in SENSORS
        }
        begin = 20 * n
        times = [begin + s for s in range(0, seconds + 1, 5)]
        truth = tuple(Truth(t_ns=T0_NS + s * 1_000_000_000, floor="F1", xy=place(s)[0]) for s in times)
        scans = tuple(
            scan("F1", place(s)[0].tolist(), t_ns=T0_NS + s * 1_000_000_000, noise_db=3.0)
            for s in range(begin + 1, begin + seconds, 2)
        )
        motion = MotionSamples(sensors=merged)
        name = f"walk-{n}"
        walks.append(SurveyWalk(name=name, chain=name, floor="F1", truth=truth, motion=motion, scans=scans))
    return Survey(floors=tuple(floors().values()), radio_map=radio_map(), walks=tuple(walks))
