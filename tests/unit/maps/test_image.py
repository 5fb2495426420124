"""The image map on small drawings, where every pixel can be counted, and on floors made of vectors."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imsave

from tickfix.api import Context, Floor
from tickfix_maps.image import Image, ImageParams, matching_matrix, medial_axis, threshold_image, to_greyscale
from tickfix_maps.raster import rasterise_rings, rasterise_segments, traverse_pixels


def drawing(*rows: str) -> np.ndarray:
    """Return a drawing, north row first as on paper: # structure, + walkway, · free."""
    return np.array([[{"#": 0.0, "+": 0.3, "·": 1.0}[c] for c in row] for row in rows])


PLAN = ("#######", "#··#··#", "#··#··#", "#·····#", "#######")
WITH_WALKWAYS = ("#######", "#··#··#", "#+·#·+#", "#+++++#", "#######")


def rooms(**params: object) -> Image:
    """Return two rooms of 4 × 6 m, beside each other, with a door 1 m wide in the south of the wall between them."""
    box = np.array([[0.0, 0.0], [8.0, 0.0], [8.0, 6.0], [0.0, 6.0]])
    walls = np.array([[[4.0, 0.0], [4.0, 1.0]], [[4.0, 2.0], [4.0, 6.0]]])
    floor = Floor(name="F", width_m=8.0, height_m=6.0, outline=(box,), walls=walls)
    return Image(ImageParams(**params), Context(floor=floor))  # type: ignore[arg-type]


def test_equation_7_calls_light_what_reaches_the_threshold() -> None:
    assert threshold_image(np.array([[0.54, 0.55, 0.56]]), 0.55).tolist() == [[False, True, True]]


def test_equation_8_tells_free_structure_and_walkway_apart() -> None:
    no_model, model = (threshold_image(to_greyscale(drawing(*rows)), 0.55) for rows in (PLAN, WITH_WALKWAYS))
    assert matching_matrix(model, no_model)[::-1].tolist() == [
        [0, 0, 0, 0, 0, 0, 0],
        [0, 1, 1, 0, 1, 1, 0],
        [0, -1, 1, 0, 1, -1, 0],
        [0, -1, -1, -1, -1, -1, 0],
        [0, 0, 0, 0, 0, 0, 0],
    ]


def test_structure_stays_structure_where_the_second_drawing_is_lighter_there() -> None:
    assert matching_matrix(np.array([[True]]), np.array([[False]])).tolist() == [[0]]


def test_plans_of_different_sizes_are_refused_with_both_sizes() -> None:
    with pytest.raises(ValueError, match=r"\(1, 2\) pixels, expected \(1, 1\)"):
        matching_matrix(np.ones((1, 2), np.bool_), np.ones((1, 1), np.bool_))


@pytest.mark.parametrize("kind", ["grey float", "grey bytes", "rgb bytes", "rgba float"])
def test_images_of_any_kind_become_grey_with_the_south_first(kind: str) -> None:
    image = np.array([[1.0, 0.0], [0.0, 0.0]])
    if "rgb" in kind:
        image = np.repeat(image[..., None], 4 if "rgba" in kind else 3, axis=2)
    if "bytes" in kind:
        image = (255 * image).astype(np.uint8)
    assert to_greyscale(image) == pytest.approx(np.array([[0.0, 0.0], [1.0, 0.0]]))


def test_drawn_floors_are_read_from_files_and_stretched_to_the_size_of_the_floor(tmp_path: Path) -> None:
    imsave(tmp_path / "F1.png", drawing(*PLAN), cmap="gray", vmin=0, vmax=1)
    imsave(tmp_path / "F1-ways.png", drawing(*WITH_WALKWAYS), cmap="gray", vmin=0, vmax=1)
    named = f"{tmp_path}/{{floor}}"
    params = ImageParams(plan=f"{named}.png", plan_with_walkways=f"{named}-ways.png", snap_across_walls=True)
    image = Image(params, Context(floor=Floor(name="F1", width_m=14.0, height_m=10.0)))
    assert (image.I_match == -1).sum() == 7
    assert image.contains(np.array([[3.0, 3.0], [7.0, 7.0], [7.0, 3.0], [1.0, 1.0]])).tolist() == [1, 0, 1, 0]
    # From the left room through the wall: the middle of the way is the wall, the walkway next to it the door.
    assert image.snap(np.array([5.0, 5.0]), np.array([9.0, 5.0])).tolist() == [7.0, 3.0]


def test_a_move_passes_every_pixel_on_its_way_in_order() -> None:
    move, row, column = traverse_pixels(np.array([[0.5, 0.5], [2.5, 0.5]]), np.array([[2.5, 1.4], [2.5, 0.6]]))
    assert move.tolist() == [0, 0, 0, 0, 1]
    assert list(zip(column.tolist(), row.tolist(), strict=True))[:4] == [(0, 0), (1, 0), (1, 1), (2, 1)]


def test_the_pixels_of_moves_are_those_that_dense_sampling_finds() -> None:
    rng = np.random.default_rng(1)
    a, b = rng.uniform(-5, 25, (200, 2)), rng.uniform(-5, 25, (200, 2))
    move, row, column = traverse_pixels(a, b)
    exact = set(zip(move.tolist(), column.tolist(), row.tolist(), strict=True))
    shares = np.linspace(0, 1, 3001)[:, None, None]
    sampled = np.floor(a + shares * (b - a)).astype(int)
    found = {(i, int(x), int(y)) for line in sampled for i, (x, y) in enumerate(line)}
    assert found <= exact
    assert len(exact - found) < 0.01 * len(exact)


@pytest.mark.parametrize("slope", [1.0, -1.0, 0.5, 2.7])
def test_no_move_slips_diagonally_through_a_drawn_wall(slope: float) -> None:
    x = np.array([0.0, 30.0])
    wall = np.stack([x, 15.0 + slope * (x - 15.0)], axis=1)[None]
    matrix = rasterise_segments(wall, (30, 30))
    rng = np.random.default_rng(2)
    a = rng.uniform(8, 22, (400, 2))
    above = a[:, 1] > 15.0 + slope * (a[:, 0] - 15.0)
    b = a[rng.permutation(400)]
    sides = above != (b[:, 1] > 15.0 + slope * (b[:, 0] - 15.0))
    move, row, column = traverse_pixels(a, b)
    stopped = np.zeros(400, np.bool_)
    stopped[move[matrix[row, column]]] = True
    assert sides.sum() > 100
    assert stopped[sides].all()


def test_rings_are_filled_by_parity_or_together() -> None:
    square = np.array([[1.0, 1.0], [5.0, 1.0], [5.0, 5.0], [1.0, 5.0]])
    shifted = square[::-1] + 2.0
    assert rasterise_rings([square], (6, 6), union=False).sum() == 16
    assert rasterise_rings([square, shifted], (8, 8), union=False).sum() == 16 + 16 - 2 * 4
    assert rasterise_rings([square, shifted], (8, 8), union=True).sum() == 16 + 16 - 4


def test_the_walkway_of_a_corridor_is_its_middle_line() -> None:
    free = np.zeros((11, 60), np.bool_)
    free[1:10, 1:59] = True
    axis = medial_axis(free, apart=7.0)
    assert axis[5, 6:54].all()
    assert not axis[[1, 2, 8, 9]].any()


def test_walkways_are_free_and_lead_through_the_door() -> None:
    image = rooms(resolution_m=0.1)
    ways = image._walkway_tree
    assert ways is not None
    assert image.contains(ways.data).all()
    assert ways.query([4.05, 1.5])[0] < 0.2


def test_a_reasonable_place_is_not_moved() -> None:
    xy = np.array([2.0, 4.0])
    image = rooms()
    assert image.snap(None, xy).tolist() == xy.tolist()
    assert image.snap(np.array([1.0, 1.0]), xy).tolist() == xy.tolist()


@pytest.mark.parametrize("xy", [(5.0, 4.0), (4.0, 4.0), (-1.0, 4.0), (9.0, 9.0), (1e9, -1e9)])
def test_a_place_behind_or_inside_structure_goes_to_the_walkway_next_to_the_midpoint(xy: tuple[float, float]) -> None:
    image, previous = rooms(snap_across_walls=True), np.array([3.0, 4.0])
    corrected = image.snap(previous, np.array(xy))
    ways = image._walkway_tree
    assert ways is not None
    middle = 0.5 * (previous + xy)
    assert np.hypot(*(corrected - middle)) == pytest.approx(np.hypot(*(ways.data - middle).T).min())
    assert image.contains(corrected[None])[0]


def test_a_place_in_structure_with_none_before_it_goes_to_the_walkway_next_to_it() -> None:
    image = rooms()
    corrected = image.snap(None, np.array([4.0, 4.0]))
    assert image.contains(corrected[None])[0]
    assert abs(corrected[0] - 4.0) <= 2.2


def test_by_default_a_correction_is_reached_without_passing_a_wall() -> None:
    image, previous, beyond = rooms(), np.array([3.5, 5.0]), np.array([7.5, 5.0])
    assert not image.crosses(previous[None], image.snap(previous, beyond)[None])[0]
    assert rooms(snap_across_walls=True).snap(previous, beyond)[0] > 4.2


def test_walls_are_crossed_and_the_door_is_open() -> None:
    image = rooms()
    a, b = np.array([[3.0, 4.0], [3.0, 1.5], [1.0, 1.0]]), np.array([[5.0, 4.0], [5.0, 1.5], [1.0, -1.0]])
    assert image.crosses(a, b).tolist() == [True, False, True]


def test_the_nearest_free_place_is_free_and_none_is_nearer() -> None:
    image = rooms()
    xy = np.array([[4.0, 4.0], [-3.0, 3.0], [2.0, 2.0], [50.0, 90.0]])
    found = image.nearest_free(xy)
    assert image.contains(found).all()
    assert found[2].tolist() == [2.0, 2.0]
    row, column = np.nonzero(image.I_match != 0)
    centres = (np.stack([column, row], axis=1) - 0.5) * 0.2  # the image begins one pixel before the floor
    for i in (0, 1, 3):
        assert np.hypot(*(found[i] - xy[i])) == pytest.approx(np.hypot(*(centres - xy[i]).T).min())


def test_a_floor_without_geometry_lets_everybody_pass() -> None:
    image = Image(ImageParams(), Context(floor=Floor(name="F")))
    a, b = np.array([[0.0, 0.0]]), np.array([[9.0, -9.0]])
    assert image.contains(a).all()
    assert not image.crosses(a, b).any()
    assert image.nearest_free(b).tolist() == b.tolist()
    assert image.snap(a[0], b[0]).tolist() == b[0].tolist()


def test_a_drawing_needs_a_floor_of_known_size(tmp_path: Path) -> None:
    imsave(tmp_path / "plan.png", drawing(*PLAN), cmap="gray")
    with pytest.raises(ValueError, match="drawing needs its size"):
        Image(ImageParams(plan=f"{tmp_path}/plan.png"), Context(floor=Floor(name="F")))


def test_a_large_floor_is_built_within_two_seconds() -> None:
    x, y = np.meshgrid(np.arange(10.0, 230.0, 12.0), np.arange(10.0, 166.0, 10.0))
    corners = np.stack([x.ravel(), y.ravel()], axis=1)
    shape = np.array([[0.0, 0.0], [8.0, 0.5], [8.0, 6.0], [0.5, 6.0]])
    outline = np.array([[1.0, 1.0], [239.0, 1.0], [239.0, 175.0], [1.0, 175.0]])
    floor = Floor(
        name="F", width_m=240.0, height_m=176.0, outline=(outline,), obstacles=tuple(c + shape for c in corners)
    )
    before = time.process_time()
    image = Image(ImageParams(), Context(floor=floor))
    image.snap(None, corners[0] + 1.0)
    assert time.process_time() - before < 2.0
    assert image.contains(corners + np.array([10.0, 3.0])).all()
    assert not image.contains(corners + np.array([4.0, 3.0])).any()
