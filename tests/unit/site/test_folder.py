"""A site comes back from disk as it was, and a damaged one is refused with its file's name."""

from __future__ import annotations

import json
import pickle
import shutil
from dataclasses import fields, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from surveys import small_site, walk

from tickfix.api import BaseMap, Context, EventError, Floor, ReaderError, Recording, SiteError, Transition
from tickfix.site import Site, load_site, save_site
from tickfix.site.data_files import load_floor, save_floor
from tickfix.site.survey_builder import read_floor_plans, survey_recordings


def plain(value: Any) -> Any:
    """Return a value made of comparable parts."""
    if isinstance(value, np.ndarray):
        return (value.dtype.str, value.shape, value.tolist())
    if hasattr(value, "items"):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return [plain(item) for item in value]
    if hasattr(value, "__dataclass_fields__"):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    return value


def content(folder: Path) -> dict[str, bytes]:
    return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    save_site(small_site(), tmp_path / "site")
    return tmp_path / "site"


def test_a_site_comes_back_as_it_was(folder: Path) -> None:
    assert plain(load_site(folder)) == plain(small_site())


def test_saving_twice_gives_equal_bytes_and_replaces_the_first(folder: Path) -> None:
    first = content(folder)
    save_site(small_site(), folder)
    save_site(load_site(folder), folder.with_name("other"))
    assert content(folder) == first == content(folder.with_name("other"))
    assert sorted(path.name for path in folder.parent.iterdir()) == ["other", "site"]


def test_what_is_loaded_cannot_be_written_to(folder: Path) -> None:
    site = load_site(folder)
    for array in (site.survey_tracks[0].xy, site.models["pdr-steps-1a2b"]["weights"], site.radio_map.sample_xy):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_held_out_walks_are_found_again_after_site_and_recordings_moved_together(tmp_path: Path) -> None:
    (tmp_path / "a" / "walks").mkdir(parents=True)
    file = tmp_path / "a" / "walks" / "w.txt"
    file.write_text("1\n", encoding="utf-8")
    held = replace_path(walk("held", [(0, 0, 0), (5, 1, 1)]), file)
    kept = replace_path(walk("kept", [(900, 0, 0), (905, 1, 1)]), file)
    site = survey_recordings([held, kept], [], holdout=0.3).site
    assert [h.walk for h in site.held_out] == ["held"]
    save_site(site, tmp_path / "a" / "site")
    assert load_site(tmp_path / "a" / "site").held_out == site.held_out
    (tmp_path / "a").rename(tmp_path / "b")
    (moved,) = load_site(tmp_path / "b" / "site").held_out
    assert moved.file() == tmp_path / "b" / "walks" / "w.txt"
    moved.file().write_text("2\n", encoding="utf-8")
    with pytest.raises(SiteError, match="has changed since the survey"):
        moved.file()
    (tmp_path / "b" / "walks" / "w.txt").unlink()
    with pytest.raises(SiteError, match="is gone"):
        load_site(tmp_path / "b" / "site").held_out[0].file()


def replace_path(recording: Recording, path: Path) -> Recording:
    return replace(recording, path=path)


def test_something_that_is_no_site_is_never_overwritten(tmp_path: Path) -> None:
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter1.tex").write_text("…", encoding="utf-8")
    with pytest.raises(SiteError, match="no tickfix site"):
        save_site(small_site(), tmp_path / "thesis")
    assert [path.name for path in tmp_path.iterdir()] == ["thesis"]


def test_a_save_that_fails_leaves_the_old_site(folder: Path) -> None:
    before = content(folder)
    broken = replace(small_site(), models={"m": {"objects": np.array([object()])}})
    with pytest.raises(SiteError, match="only numbers and strings"):
        save_site(broken, folder)
    assert content(folder) == before
    assert [path.name for path in folder.parent.iterdir()] == ["site"]


def edit(path: Path, **changes: Any) -> None:
    path.write_text(json.dumps(json.loads(path.read_text(encoding="utf-8")) | changes), encoding="utf-8")


def rewrite(path: Path, **changes: Any) -> None:
    with np.load(path) as file:
        arrays = dict(file)
    arrays |= changes
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})


def npy(array: np.ndarray) -> bytes:
    buffer = BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


DAMAGES = {
    "no site.json": (lambda f: (f / "site.json").unlink(), r"found no site\.json.*tickfix survey"),
    "old format": (lambda f: edit(f / "site.json", format=0), r"site\.json: found format 0.*expected 1.*survey again"),
    "wrong type": (lambda f: edit(f / "site.json", floors=3), r"site\.json: Expected `array`.*floors"),
    "no JSON": (lambda f: (f / "site.json").write_text("{"), r"site\.json: .*survey again"),
    "no radio map": (lambda f: (f / "radio_map.npz").unlink(), r"radio_map\.npz: missing"),
    "cut radio map": (
        lambda f: (f / "radio_map.npz").write_bytes((f / "radio_map.npz").read_bytes()[:99]),
        r"radio_map\.npz: found no readable",
    ),
    "pickle": (lambda f: (f / "radio_map.npz").write_bytes(pickle.dumps({})), r"radio_map\.npz: found no readable"),
    "pickled array": (
        lambda f: np.savez(f / "radio_map.npz", floors=np.array([{}])),
        r"radio_map\.npz: found no readable.*without pickles",
    ),
    "single array": (
        lambda f: (f / "radio_map.npz").write_bytes(npy(np.zeros(3))),
        r"radio_map\.npz: found a single array",
    ),
    "missing array": (lambda f: rewrite(f / "radio_map.npz", point_xy=None), r"radio_map\.npz: .*missing: \['point_xy"),
    "wrong shape": (
        lambda f: rewrite(f / "radio_map.npz", sample_xy=np.zeros((2, 3))),
        r"radio_map\.npz: sample_xy: found shape",
    ),
    "index out of range": (
        lambda f: rewrite(f / "radio_map.npz", point_floor=np.full(len(load_site(f).radio_map), 9)),
        r"radio_map\.npz: point_floor goes from 9",
    ),
    "tracks apart": (lambda f: rewrite(f / "survey_tracks.npz", xy=np.zeros((1, 2))), r"survey_tracks\.npz: found"),
    "no model": (lambda f: (f / "models" / "pdr-steps-1a2b.npz").unlink(), r"pdr-steps-1a2b\.npz: missing"),
    "no floor": (lambda f: (f / "floors" / "F1.geojson").unlink(), r"F1\.geojson: missing"),
    "no GeoJSON": (lambda f: (f / "floors" / "F1.geojson").write_text("[]"), r"F1\.geojson: found no GeoJSON"),
    "a wall that is a point": (
        lambda f: (f / "floors" / "F1.geojson").write_text(
            '{"features": [{"properties": {"role": "wall"}, "geometry": {"type": "Point", "coordinates": [1, 2]}}]}'
        ),
        r"F1\.geojson: found Point with 1 points as wall",
    ),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_site_is_refused_with_the_files_name_and_the_remedy(folder: Path, damage: str) -> None:
    harm, message = DAMAGES[damage]
    harm(folder)
    with pytest.raises(SiteError, match=message):
        load_site(folder)


coordinate = st.floats(-1e6, 1e6)
ring = st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=6, unique=True).map(np.array)


@given(st.lists(ring, max_size=3), st.lists(ring, max_size=3), st.lists(st.tuples(*[coordinate] * 4), max_size=3))
def test_any_geometry_comes_back_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory, outline: list, obstacles: list, walls: list
) -> None:
    path = tmp_path_factory.mktemp("floor") / "F1.geojson"
    floor = Floor(
        name="F1", outline=tuple(outline), obstacles=tuple(obstacles), walls=np.array(walls).reshape(-1, 2, 2)
    )
    save_floor(path, floor)
    assert plain(load_floor(path, name="F1", level=0, width_m=0.0, height_m=0.0)) == plain(floor)
    shutil.rmtree(path.parent)


def test_a_plan_edited_in_a_gis_tool_is_read(tmp_path: Path) -> None:
    square = [[0, 0], [9, 0], [9, 9], [0, 9], [0, 0]]
    hole = [[1, 1], [2, 1], [2, 2], [1, 1]]
    features = [
        ("outline", "MultiPolygon", [[square, hole], [[[20, 0], [21, 0], [21, 1], [20, 0]]]]),
        ("wall", "LineString", [[0, 5], [3, 5], [3, 9]]),
        ("comment", "Point", [4, 4]),
    ]
    path = tmp_path / "F1.geojson"
    path.write_text(
        json.dumps(
            {
                "type": "FeatureCollection",
                "features": [
                    {"type": "Feature", "properties": {"role": r}, "geometry": {"type": t, "coordinates": c}}
                    for r, t, c in features
                ],
            }
        ),
        encoding="utf-8",
    )
    floor = load_floor(path, name="F1", level=1, width_m=21.0, height_m=9.0)
    assert [len(ring) for ring in floor.outline] == [4, 3, 3]
    assert floor.walls.tolist() == [[[0, 5], [3, 5]], [[3, 5], [3, 9]]]


class PlanReader:
    """Knows the plan of F1, has a broken one of F2 and none of any other floor."""

    kind = "reader"
    name = "plan"

    def recordings(self, path: Path) -> list[Path]:
        return [path]

    def read(self, path: Path) -> Recording:
        return replace(walk(path.stem, [(0, 0, 0), (5, 1, 1)], floor=path.parent.name), path=path)

    def floor(self, path: Path) -> Floor | None:
        if path.parent.name == "F2":
            raise ReaderError(f"{path.parent}/plan.json: broken")
        return Floor(name="F1", level=1) if path.parent.name == "F1" else None


def test_floors_are_gathered_once_and_broken_plans_reported() -> None:
    reader = PlanReader()
    recordings = [reader.read(Path(p)) for p in ("s/F1/a", "s/F1/b", "s/F2/c", "s/F3/d")]
    floors, problems = read_floor_plans(reader, recordings)
    assert [floor.name for floor in floors] == ["F2", "F3", "F1"]
    assert problems == ("s/F2/plan.json: broken",)


def test_one_floors_name_in_two_buildings_is_refused() -> None:
    reader = PlanReader()
    with pytest.raises(SiteError, match=r"floor 'F1' lie in .*site1/F1 and in .*site2/F1.*one building at a time"):
        survey_recordings([reader.read(Path("site1/F1/a")), reader.read(Path("site2/F1/b"))], [])


def test_a_site_names_the_floors_it_has() -> None:
    site = small_site()
    assert site.floor("F1").level == 1
    with pytest.raises(SiteError, match="found no floor 'F9'; it has"):
        site.floor("F9")


def test_an_empty_site_comes_back_too(tmp_path: Path) -> None:
    site = survey_recordings([walk("w", [(0, 0, 0), (5, 1, 1)])], []).site
    save_site(site, tmp_path / "site")
    loaded = load_site(tmp_path / "site")
    assert isinstance(loaded, Site)
    assert len(loaded.radio_map) == 0
    assert plain(loaded) == plain(site)


STAIRS = Transition(
    kind="stairs",
    floors=("F1", "F2"),
    areas=(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.0]]), np.array([[1.5, 2.5]])),
)


def test_transitions_and_elevations_come_back_and_cost_other_sites_no_byte(tmp_path: Path) -> None:
    flat = small_site()
    names = [floor.name for floor in flat.floors]
    plain_site = save_and_read(flat, tmp_path / "flat")
    assert "elevation_m" not in plain_site
    assert "transitions" not in plain_site
    upper = replace(flat.floors[0], name="F2", level=2, elevation_m=4.25)
    lower = replace(flat.floors[0], name="F1", elevation_m=0.0)
    others = tuple(floor for floor in flat.floors if floor.name not in ("F1", "F2"))
    tall = replace(flat, floors=(lower, *others, upper), transitions=(STAIRS,))
    save_site(tall, tmp_path / "tall")
    found = load_site(tmp_path / "tall")
    assert plain(found) == plain(tall)
    assert [found.floor(name).elevation_m for name in ("F1", "F2")] == [0.0, 4.25]
    assert names


def save_and_read(site: Site, folder: Path) -> str:
    save_site(site, folder)
    return (folder / "site.json").read_text("utf-8")


def test_a_transition_to_a_floor_that_is_not_there_is_refused() -> None:
    site = small_site()
    with pytest.raises(SiteError, match="found a transition"):
        replace(site, floors=(replace(site.floors[0], name="F1"),), transitions=(STAIRS,))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"kind": "ladder"}, "found 'ladder'"),
        ({"floors": ("F1", "F1")}, "two different floors"),
        ({"areas": (np.zeros((2, 2)), np.zeros((1, 2)))}, "found 2 points"),
        ({"areas": (np.full((3, 2), np.nan), np.zeros((1, 2)))}, "finite ring"),
    ],
)
def test_a_transition_that_cannot_be_is_refused(change: dict[str, Any], says: str) -> None:
    with pytest.raises(EventError, match=says):
        replace(STAIRS, **change)


def test_maps_have_the_transitions_of_their_floor() -> None:
    class Open(BaseMap[Any]):
        def contains(self, xy: Any) -> Any: ...
        def crosses(self, a: Any, b: Any) -> Any: ...
        def nearest_free(self, xy: Any) -> Any: ...
        def snap(self, previous: Any, xy: Any) -> Any: ...

    lift = Transition(kind="lift", floors=("F2", "F3"), areas=(np.zeros((1, 2)), np.zeros((1, 2))))
    context = Context(transitions=(STAIRS, lift))
    assert Open(None, replace(context, floor=Floor(name="F1"))).transitions == (STAIRS,)
    assert Open(None, replace(context, floor=Floor(name="F2"))).transitions == (STAIRS, lift)
    assert Open(None, context).transitions == ()
    assert STAIRS.other_floor("F1") == "F2"
    assert STAIRS.area("F2") is STAIRS.areas[1]
    assert STAIRS.area("F3") is None
