"""The particle filter where its first fix was wrong, where single fixes are, and where walls keep it from the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from walks import errors, fixes, fold, walk

from tickfix.api import Bools, Context, Fix, Floats
from tickfix_filters.fusion_pf import FusionPf, FusionPfParams


class TwoCorridors:
    """Corridors along y, 3 m wide, around x = 0 and x = 25: nobody passes from one to the other."""

    def contains(self, xy: Floats) -> Bools:
        inside: Bools = (np.abs(xy[:, 0]) <= 1.5) | (np.abs(xy[:, 0] - 25.0) <= 1.5)
        return inside

    def crosses(self, a: Floats, b: Floats) -> Bools:
        return ~(self.contains(a) & self.contains(b)) | (np.abs(a[:, 0] - b[:, 0]) > 3.0)

    def nearest_free(self, xy: Floats) -> Floats:
        middle = np.where(xy[:, 0] < 12.5, 0.0, 25.0)
        return np.column_stack([middle + np.clip(xy[:, 0] - middle, -1.5, 1.5), xy[:, 1]])

    def snap(self, previous: Floats | None, xy: Floats) -> Floats:
        return self.nearest_free(xy[None])[0]


MAPPED = Context(maps={"F": TwoCorridors()})
NEVER = {"reset_distance_m": 1e6}
# Walls count in full, however poor the fixes, and no particle begins in the other corridor.
KEPT = {"reference_sigma_m": 1e6, "initial_sigma_m": 8.0}


def north(t_s: float) -> float:
    return 0.0


def from_where_nobody_surveyed(places: Floats) -> dict[int, Fix]:
    """Poor fixes in the other corridor for ten seconds, then as poor ones around the truth."""
    rng = np.random.default_rng(4)
    found = {}
    for k, fix in fixes(places, rng, 4.0).items():
        off = (25.0, 0.0) if k < 50 else (0.0, 0.0)
        found[k] = replace(fix, xy=fix.xy + off, covariance=15.0**2 * np.eye(2))
    return found


def test_a_wrong_start_that_walls_keep_wrong_ends_soon_after_fixes_become_right() -> None:
    motions, places = walk(40.0, north)
    seen = from_where_nobody_surveyed(places)
    off: dict[str, list[float]] = {"reinitialised": [], "never": []}
    for seed in range(10):
        for name, params in (("reinitialised", KEPT), ("never", NEVER | KEPT)):
            pf = FusionPf(FusionPfParams(**params), MAPPED)
            error = errors(pf, fold(pf, motions, seen, np.random.default_rng(seed)), places)
            assert error[:50].min() > 15.0
            off[name].append(float(error[100:].mean()))
    assert max(off["reinitialised"]) < 5.0
    assert max(off["never"]) > 15.0
    assert np.mean(off["never"]) > 2.0 * np.mean(off["reinitialised"])


def test_walls_do_not_keep_a_start_that_poor_fixes_made_wrong() -> None:
    motions, places = walk(40.0, north)
    pf = FusionPf(FusionPfParams(**NEVER), MAPPED)
    folded = fold(pf, motions, from_where_nobody_surveyed(places), np.random.default_rng(5))
    assert folded[-1][0].fix_quality == pytest.approx(5.0 / 15.0)
    off = errors(pf, folded, places)
    assert off[:50].min() > 15.0
    assert off[100:].mean() < 5.0


def test_what_begins_anew_says_so_and_still_faces_the_same_way() -> None:
    motions, places = walk(40.0, north)
    pf = FusionPf(FusionPfParams(**KEPT), MAPPED)
    folded = fold(pf, motions, from_where_nobody_surveyed(places), np.random.default_rng(5))
    reinitialised = [k for k, (_, report) in enumerate(folded) if "reinitialised" in report.reasons]
    assert 50 < reinitialised[0] < 100
    state, report = folded[reinitialised[0]]
    assert report.lost
    assert report.used == 1
    assert state.heading_rad == folded[reinitialised[0] - 1][0].heading_rad
    assert state.motion is not None
    assert np.hypot(*state.mean_fix_offset) == 0.0
    assert state.bias_rad.std() == pytest.approx(state.motion.heading_rad, rel=0.2)


@pytest.mark.parametrize(
    "gross", [{100: (60.0, 0.0)}, {k: (25.0 * (-1) ** (k // 10), 0.0) for k in range(40, 200, 10)}]
)
def test_gross_fixes_to_one_side_and_the_other_do_not_begin_it_anew(gross: dict[int, tuple[float, float]]) -> None:
    motions, places = walk(40.0, north)
    seen = fixes(places, np.random.default_rng(6), 4.0, gross=gross)
    last = [
        fold(FusionPf(FusionPfParams(**params), Context()), motions, seen, np.random.default_rng(7))[-1][0]
        for params in ({}, NEVER)
    ]
    assert np.array_equal(last[0].xy, last[1].xy)
