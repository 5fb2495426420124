"""The filter that holds the last fix, and the map that may correct it."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from tickfix.api import Context, Fix, Floor
from tickfix_filters.fixes import Fixes, FixesParams
from tickfix_maps.image import Image, ImageParams

RNG = np.random.default_rng(0)
BOX = np.array([[0.0, 0.0], [8.0, 0.0], [8.0, 6.0], [0.0, 6.0]])
FLOOR = Floor(name="F", width_m=8.0, height_m=6.0, outline=(BOX,), walls=np.array([[[4.0, 0.0], [4.0, 6.0]]]))


def fix(x: float, floor: str = "F") -> Fix:
    return Fix(t_ns=0, floor=floor, xy=np.array([x, 3.0]))


def test_a_fix_behind_a_wall_is_corrected_only_where_that_is_asked_for() -> None:
    image = Image(ImageParams(), Context(floor=FLOOR))
    context = Context(maps=MappingProxyType({"F": image}))
    plain, map_matching = Fixes(FixesParams(), context), Fixes(FixesParams(map_matching=True), context)
    for filter_, expected in ((plain, fix(5.0).xy), (map_matching, image.snap(fix(3.0).xy, fix(5.0).xy))):
        state, _ = filter_.update(filter_.begin(fix(3.0), RNG), fix(5.0), RNG)
        np.testing.assert_array_equal(filter_.estimate(state).xy, expected)
    assert image.snap(fix(3.0).xy, fix(5.0).xy)[0] < 4.0


def test_a_correction_comes_from_the_last_place_as_it_was_corrected() -> None:
    image = Image(ImageParams(), Context(floor=FLOOR))
    map_matching = Fixes(FixesParams(map_matching=True), Context(maps=MappingProxyType({"F": image})))
    first = map_matching.begin(fix(3.0), RNG)
    second, _ = map_matching.update(first, fix(5.0), RNG)
    third, _ = map_matching.update(second, fix(5.0), RNG)
    np.testing.assert_array_equal(third.xy, image.snap(second.xy, fix(5.0).xy))
    assert third.xy[0] < 4.0


def test_without_a_map_or_on_a_floor_without_one_fixes_stay() -> None:
    map_matching = Fixes(FixesParams(map_matching=True), Context())
    state, report = map_matching.update(map_matching.begin(fix(3.0), RNG), fix(5.0, "G"), RNG)
    assert (state.floor, state.xy.tolist(), report.innovation_m) == ("G", [5.0, 3.0], None)
