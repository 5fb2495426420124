"""Every way of naming pipelines, and what is said of those that are not understood."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest

import tickfix
from tickfix.api import Belief, ConfigError, Fix, Floats, Motion, PredictUpdateFilter, Report, Rng, parameter
from tickfix.evaluation.tracks import digest
from tickfix.replay.site_survey import site_context
from tickfix.workflow.pipelines import resolve_pipeline, resolve_pipelines


@dataclass(frozen=True)
class Place:
    floor: str
    xy: Floats


@dataclass(frozen=True)
class PartwayParams:
    share: Annotated[float, parameter("of the way to a fix", gt=0, le=1)] = 0.5


class Partway(PredictUpdateFilter[PartwayParams, Place]):
    """Goes part of the way to every fix."""

    name = "partway"
    Params = PartwayParams
    State = Place

    def begin(self, fix: Fix, rng: Rng) -> Place:
        return Place(fix.floor, fix.xy)

    def predict(self, state: Place, motion: Motion, rng: Rng) -> Place:
        return state

    def update(self, state: Place, fix: Fix, rng: Rng) -> tuple[Place, Report]:
        return Place(fix.floor, state.xy + self.params.share * (fix.xy - state.xy)), Report(used=1)

    def estimate(self, state: Place) -> Belief:
        return Belief(floor=state.floor, xy=state.xy, covariance=9.0 * np.eye(2))


def names(spec: Any) -> list[str]:
    return [pipeline.name for pipeline in resolve_pipelines(spec).pipelines]


def test_names_files_and_dictionaries(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('seed = 7\n[pipelines.mine]\nfingerprint = "wknn"\nfilter = "fixes"\n', "utf-8")
    assert names(None) == ["wifi", "pdr", "kalman", "fusion"]
    assert names("fusion") == ["fusion"]
    assert names(file) == names(str(file)) == ["mine"]
    assert resolve_pipelines(file).kernel.seed == 7
    assert resolve_pipelines(file, seed=3).kernel.seed == 3
    stages = {"pdr": "steps", "fingerprint": {"use": "wknn", "k": np.int64(6)}, "filter": "kalman"}
    assert names(stages) == ["kalman"]
    fingerprint = resolve_pipelines(stages).pipelines[0].fingerprint
    assert fingerprint is not None
    assert fingerprint.params.k == 6
    assert names({"a": stages, "b": "fusion", "c": Partway}) == ["a", "b", "c"]
    assert names({"pipelines": {"a": stages}, "seed": 3}) == ["a"]
    assert names(["wifi", stages, "kalman", resolve_pipelines("pdr")]) == ["wifi", "kalman", "kalman-2", "pdr"]


def test_a_list_of_values_is_a_sweep() -> None:
    assert names({"fingerprint": {"use": "wknn", "k": [3, 5]}, "filter": "fixes"}) == ["fixes[k=3]", "fixes[k=5]"]


def test_a_class_alone_takes_its_place_in_fusion() -> None:
    (pipeline,) = resolve_pipelines(Partway).pipelines
    fusion = resolve_pipeline("fusion").pipelines[0]
    assert pipeline.name == "partway"
    assert pipeline.filter.offer.cls is Partway
    assert (pipeline.pdr, pipeline.fingerprint, pipeline.map) == (fusion.pdr, fusion.fingerprint, fusion.map)


def test_classes_and_objects_track_alike(walk: tickfix.Recording, site: tickfix.Site) -> None:
    by_class = tickfix.track(walk, site, {"fingerprint": "wknn", "filter": Partway})
    with_params = tickfix.track(walk, site, {"fingerprint": "wknn", "filter": {"use": Partway, "share": 0.5}})
    built = Partway(PartwayParams(share=0.5), site_context(site))
    by_object = tickfix.track(walk, site, {"fingerprint": "wknn", "filter": built})
    assert digest(by_class) == digest(with_params) == digest(by_object)
    other = tickfix.track(walk, site, {"fingerprint": "wknn", "filter": {"use": Partway, "share": 1.0}})
    assert digest(other) != digest(by_class)


def test_two_objects_of_one_class_are_two_pipelines(walk: tickfix.Recording, site: tickfix.Site) -> None:
    class Elsewhere(Partway):
        shift_m = 0.0

        def estimate(self, state: Place) -> Belief:
            return Belief(floor=state.floor, xy=state.xy + self.shift_m, covariance=np.eye(2))

    here, there = (Elsewhere(PartwayParams(), None) for _ in range(2))  # type: ignore[arg-type]
    there.shift_m = 100.0
    tracks = tickfix.track_all(
        walk, site, {name: {"fingerprint": "wknn", "filter": f} for name, f in (("here", here), ("there", there))}
    )
    apart_m = tracks["there"].to_numpy()["x_m"] - tracks["here"].to_numpy()["x_m"]
    assert np.isfinite(apart_m).any()
    assert np.allclose(apart_m[np.isfinite(apart_m)], 100.0)


def test_an_own_class_goes_before_a_registered_one_of_its_name(walk: tickfix.Recording, site: tickfix.Site) -> None:
    class Kalman(Partway):
        name = "kalman"

    config = resolve_pipelines([{"fingerprint": "wknn", "filter": Kalman}, "kalman"])
    assert [p.filter.offer.cls is Kalman for p in config.pipelines] == [True, False]


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("fusoin", "'fusoin'; expected one of wifi, pdr, kalman, fusion, a file"),
        ("missing.toml", r"missing\.toml: found no readable file"),
        ({"fingerprint": "wnn", "filter": "fixes"}, "did you mean 'wknn'|wknn"),
        ({"fingerprint": {"use": "wknn", "k": 0}, "filter": "fixes"}, r"fingerprint\.k: found 0; expected integer ≥ 1"),
        ({"filter": "fixes"}, "neither pdr nor fingerprint"),
        ({"pdr": Partway, "filter": "fixes"}, "class Partway, a filter"),
        ({"fingerprint": "wknn", "filter": int}, "expected an algorithm"),
        ([], "found none"),
        (3, "found 3"),
    ],
)
def test_what_is_not_understood_is_named(spec: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        resolve_pipelines(spec)


def test_one_pipeline_is_one(site: tickfix.Site, walk: tickfix.Recording) -> None:
    with pytest.raises(ConfigError, match=r"4 pipelines \(wifi, pdr, kalman, fusion\)"):
        tickfix.track(walk, site, None)
