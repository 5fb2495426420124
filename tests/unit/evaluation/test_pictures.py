"""Pictures: what is in them is looked at by people; here they are made, alike every time, from whatever comes."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from tickfix.api import TICK_NS, Fix, Floor, Truth
from tickfix.evaluation.pictures import REGION_95, animate_walk, crop, draw_cdf, draw_walk
from tickfix.evaluation.theme import line_styles, printable

BOX = np.array([[0.0, 0.0], [40.0, 0.0], [40.0, 30.0], [0.0, 30.0], [0.0, 0.0]])
HOLE = BOX * 0.3 + 10.0
BOW_TIE = np.array([[1.0, 1.0], [5.0, 5.0], [5.0, 1.0], [1.0, 5.0]])
FLOOR = Floor(
    name="F1",
    width_m=40,
    height_m=30,
    outline=(BOX, HOLE),
    obstacles=(BOW_TIE, HOLE * 0.2),
    walls=np.array([[[0.0, 15.0], [10.0, 15.0]]]),
)
TRUTH = [Truth(t_ns=k * TICK_NS, floor="F1", xy=np.array([k, 5.0])) for k in (1, 20, 39)]
WAY = [(float(k), 5.0 + np.sin(k)) for k in range(40)]


@pytest.fixture
def tracks(track_of: Any) -> dict[str, Any]:
    return {"_wifi": track_of([None, *WAY]), "fusion $x_1$": track_of(WAY, floors=["F1"] * 20 + ["F2"] * 20)}


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_the_same_walk_gives_the_same_bytes(tmp_path: Path, tracks: Any, suffix: str) -> None:
    fixes = [Fix(t_ns=0, floor=floor, xy=np.array([3.0, 4.0])) for floor in ("F1", "F2")]
    files = [tmp_path / f"{name}.{suffix}" for name in "ab"]
    for file in files:
        draw_walk(FLOOR, TRUTH, tracks, fixes, file, title="walk")
    assert files[0].read_bytes() == files[1].read_bytes()
    assert len(files[0].read_bytes()) > 5000


def test_a_picture_has_no_date_in_it(tmp_path: Path, tracks: Any) -> None:
    draw_walk(FLOOR, TRUTH, tracks, [], tmp_path / "walk.svg")
    assert "<dc:date>" not in (tmp_path / "walk.svg").read_text(encoding="utf-8")


def test_a_floor_without_geometry_and_a_title_in_any_script_will_do(tmp_path: Path, tracks: Any) -> None:
    draw_walk(Floor(name="F1"), TRUTH, tracks, np.array([[1.0, 2.0]]), tmp_path / "walk.png", title="楼 $\\frac 1$")
    assert (tmp_path / "walk.png").exists()


@pytest.mark.parametrize("truth", [TRUTH, []])
@pytest.mark.parametrize("places", [[], [None], [(3.0, 4.0)], None])
def test_a_walk_may_lack_anything(tmp_path: Path, track_of: Any, truth: Any, places: Any) -> None:
    draw_walk(FLOOR, truth, {} if places is None else {"p": track_of(places)}, [], tmp_path / "walk.png")
    assert (tmp_path / "walk.png").exists()


def test_beliefs_with_infinite_or_no_uncertainty_are_drawn(tmp_path: Path, track_of: Any) -> None:
    for sigma_m in (0.0, np.inf):
        draw_walk(FLOOR, TRUTH, {"p": track_of(WAY, sigma_m=sigma_m)}, [], tmp_path / "walk.png")


def test_more_pipelines_than_colours_are_drawn(tmp_path: Path, track_of: Any) -> None:
    draw_walk(FLOOR, TRUTH, {f"p{i}": track_of(WAY) for i in range(9)}, [], tmp_path / "walk.png", regions_of="p1")
    assert len(line_styles(9)) == 9
    assert line_styles(9)[-1].dashes == "solid"
    assert len({line.color for line in line_styles(6)}) == 6


def test_a_region_of_a_pipeline_that_is_not_there_is_refused_by_name(tmp_path: Path, tracks: Any) -> None:
    with pytest.raises(ValueError, match=r"'pdr'.*_wifi"):
        draw_walk(FLOOR, TRUTH, tracks, [], tmp_path / "walk.png", regions_of="pdr")


def test_another_suffix_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"found the suffix '.pdf', expected .png or .svg"):
        draw_cdf({}, tmp_path / "cdf.pdf")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("errors", [{}, {"a": []}, {"a": [0.0]}, {"a": [1.0, 2.0, 500.0] * 30, "_b": [], "楼": [3.0]}])
def test_any_errors_have_a_distribution(tmp_path: Path, errors: dict[str, list[float]]) -> None:
    given_errors = {name: np.array(values) for name, values in errors.items()}
    for name in ("a.svg", "b.svg"):
        draw_cdf(given_errors, tmp_path / name, title="errors")
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_the_region_holds_95_percent_of_a_gaussian() -> None:
    points = np.random.default_rng(1).normal(size=(200_000, 2))
    assert np.mean(np.hypot(*points.T) <= REGION_95) == pytest.approx(0.95, abs=0.002)


PLACES = st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50)), min_size=1, max_size=20).map(np.array)


@given(PLACES, PLACES)
def test_the_crop_shows_the_whole_walk_with_a_margin_and_is_never_slim(walk: Any, tracks: Any) -> None:
    low, high = crop(walk, tracks)
    assert (walk >= low + 3.9).all()
    assert (walk <= high - 3.9).all()
    assert (high - low).min() >= max(19.9, 0.44 * (high - low).max())


def test_a_track_that_goes_astray_does_not_shrink_the_walk() -> None:
    walk = np.array([[0.0, 0.0], [30.0, 0.0]])
    low, high = crop(walk, np.array([[35.0, 0.0], [5000.0, 0.0]]))
    assert high[0] == 39.0
    assert low[0] == -4.0


def test_characters_the_font_has_not_become_boxes() -> None:
    assert printable("Fläche, α\n楼") == "Fläche, α\n▯"


def test_drawing_never_asks_for_pyplot(tmp_path: Path, tracks: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    draw_walk(FLOOR, TRUTH, tracks, [], tmp_path / "walk.png")
    assert (tmp_path / "walk.png").exists()


def test_a_moving_picture_has_a_frame_a_moment_and_is_the_same_twice(tmp_path: Path, tracks: Any) -> None:
    files = [tmp_path / f"{name}.gif" for name in "ab"]
    for file in files:
        animate_walk(FLOOR, TRUTH, tracks, file, every_s=0.6)
    assert files[0].read_bytes() == files[1].read_bytes()
    with Image.open(files[0]) as picture:
        seconds = (TRUTH[-1].t_ns - TRUTH[0].t_ns) * 1e-9
        assert picture.n_frames == int(np.ceil(seconds / 0.6)) + 1
