"""The survey and the test of [sun2013] section 4.1, simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tickfix.api import Floats, Recording, Rng, Scan
from tickfix.reproduction.sun2013 import choices, site
from tickfix.simulation import START_NS, build, simulate_stand

_BREAK_NS = 120_000_000_000
_DAY_NS = 86_400_000_000_000


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Campaign:
    """What one seed gives.

    Attributes:
        survey: a recording per reference point.
        samples: for each of the T test points its samples, as scans of half a second.
        xy: (T, 2) the test points.
    """

    survey: tuple[Recording, ...]
    samples: tuple[tuple[Scan, ...], ...]
    xy: Floats


def campaign(seed: int) -> Campaign:
    """Draw the radio of the floor, survey it, and collect the test samples a day later."""
    radio_rng, look_rng, survey_rng, test_rng = np.random.default_rng([seed, 2013]).spawn(4)
    building = build([site.floor()], site.access_points(), radio_rng, propagation=choices.PROPAGATION)
    points = site.reference_points()
    looks = look_rng.uniform(-np.pi, np.pi, len(points))

    def stands(
        places: Floats, headings: Floats, seconds: float, start_ns: int, rng: Rng, label: str
    ) -> Sequence[Recording]:
        return [
            simulate_stand(
                building,
                site.FLOOR,
                (float(xy[0]), float(xy[1])),
                mine,
                name=f"{label}-{n:02d}",
                # A sample more than is needed is begun, so that the last one needed ends in time.
                seconds=seconds + 0.25,
                heading_rad=float(heading),
                receiver=choices.RECEIVER,
                start_ns=start_ns + n * (round(seconds * 1e9) + _BREAK_NS),
            )
            for n, (xy, heading, mine) in enumerate(zip(places, headings, rng.spawn(len(places)), strict=True))
        ]

    xy, headings = site.test_points()
    tested = stands(xy, headings, choices.TEST_S, START_NS + _DAY_NS, test_rng, "test")
    return Campaign(
        survey=tuple(stands(points, looks, choices.SURVEY_S, START_NS, survey_rng, "point")),
        samples=tuple(tuple(event for event in stand.events if isinstance(event, Scan)) for stand in tested),
        xy=xy,
    )
