"""TOML becomes pipelines, or an error that says where, what was found and what is allowed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import pytest

from tickfix.api import (
    BaseFilter,
    BaseFingerprint,
    BaseMap,
    ConfigError,
    Context,
    Floor,
    PluginError,
    Preset,
    parameter,
)
from tickfix.api import Stateless as Empty
from tickfix.config import Config, build_pipelines, describe_parameters, load_config, parse_config
from tickfix.registry import Offer, Registry


@dataclass(frozen=True)
class NearParams:
    """Parameters of a fingerprint."""

    k: Annotated[int, parameter("neighbours", unit="", ge=1, le=9, trains=True)] = 5
    reach_m: Annotated[float, parameter("how far", unit="m", source="eq. (1)", gt=0)] = 3.0
    mode: Annotated[Literal["a", "b"], parameter("which")] = "a"
    mirror: bool = False


class Near(BaseFingerprint[NearParams]):
    """A fingerprint that finds nothing."""

    name = "near"
    Params = NearParams
    State = Empty
    presets: ClassVar[Mapping[str, Preset]] = {"paper2000": Preset("[paper2000]", {"k": 7, "mode": "b"})}

    def start(self) -> Empty:
        return Empty()

    def step(self, state: Any, window: Any) -> Any:
        return state, None


class Last(BaseFilter[Any]):
    """A filter that begins nowhere."""

    name = "last"
    State = Empty

    def start(self, prior: Any, rng: Any) -> None:
        return None

    def step(self, state: Any, motion: Any, observations: Any, rng: Any) -> Any:
        raise NotImplementedError

    def estimate(self, state: Any) -> Any:
        raise NotImplementedError


class Plain(BaseMap[Any]):
    """A map without walls, that refuses attics."""

    name = "plain"

    def __init__(self, params: Any, context: Context, trained: Any = None) -> None:
        super().__init__(params, context, trained)
        if context.floor is not None and context.floor.name == "attic":
            raise ValueError("it is dark")

    def contains(self, xy: Any) -> Any: ...
    def crosses(self, a: Any, b: Any) -> Any: ...
    def nearest_free(self, xy: Any) -> Any: ...
    def snap(self, previous: Any, xy: Any) -> Any: ...


REGISTRY = Registry(Offer(cls.kind, cls.name, cls, "test", "test", "1") for cls in (Near, Last, Plain))


def read(text: str) -> Config:
    return parse_config(text, "my.toml", REGISTRY)


def pipeline(fingerprint: str, *, filter_: str = '"last"') -> Config:
    return read(f"[pipelines.a]\nfingerprint = {fingerprint}\nfilter = {filter_}\n")


def test_a_preset_gives_way_to_what_stands_beside_it() -> None:
    (a,) = pipeline('{ use = "near", preset = "paper2000", k = 2 }').pipelines
    assert a.fingerprint is not None
    assert a.fingerprint.params == NearParams(k=2, mode="b")


def test_settings_reach_the_kernel() -> None:
    config = read('seed = 7\nhorizon_s = 3\n[pipelines.a]\nfingerprint = "near"\nfilter = "last"\n')
    assert (config.kernel.seed, config.kernel.horizon_s) == (7, 3.0)


@pytest.mark.parametrize(
    ("fingerprint", "says"),
    [
        ('"naer"', r"my.toml: pipelines.a.fingerprint.use: found 'naer'; expected Did you mean 'near'"),
        ('{ use = "near", k = 0 }', r"my.toml: pipelines.a.fingerprint.k: found 0; expected integer ≥ 1 and ≤ 9"),
        ('{ use = "near", k = "x" }', r"found 'x'; expected integer ≥ 1"),
        ('{ use = "near", mode = "c" }', r"fingerprint.mode: found 'c'; expected one of 'a', 'b'"),
        ('{ use = "near", q = 1 }', r"fingerprint.q: found an unknown key of fingerprint 'near'; expected one of k,"),
        ('{ use = "near", preset = "paper" }', r"preset: found 'paper'; expected one of paper2000 \(did you mean"),
        ("3", r"pipelines.a.fingerprint: found 3; expected { use ="),
    ],
)
def test_an_error_names_file_key_value_and_what_is_allowed(fingerprint: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        pipeline(fingerprint)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[pipelines.a", "my.toml: found .*expected valid TOML"),
        ("", "my.toml: pipelines: found {}; expected at least one table"),
        ("seeds = 1\n", "my.toml: seeds: found an unknown key; expected one of seed,"),
        ("seed = -1\n", "my.toml: seed: found -1"),
        ('[pipelines.a]\nfingerprint = "near"\n', "found no filter"),
        ('[pipelines.a]\nfilter = "last"\n', "found neither pdr nor fingerprint"),
        ('[pipelines.a]\nfilters = "last"\n', r"did you mean 'filter'\?"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused(text: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        read(text)


def test_a_model_serves_all_choices_that_training_does_not_tell_apart() -> None:
    config = read(
        "".join(
            f'[pipelines.{name}]\nfingerprint = {{ use = "near", {value} }}\nfilter = "last"\n'
            for name, value in {"a": "reach_m = 1.0", "b": "reach_m = 2.0", "c": "k = 1"}.items()
        )
    )
    a, b, c = (p.fingerprint for p in config.pipelines)
    assert a is not None
    assert b is not None
    assert c is not None
    assert a.model == b.model != c.model
    assert a.key != b.key


def test_stages_chosen_alike_are_built_once() -> None:
    text = "".join(f'[pipelines.{name}]\nfingerprint = "near"\nfilter = "last"\nmap = "plain"\n' for name in "ab")
    floors = {name: Floor(name=name) for name in ("F1", "F2")}
    a, b = build_pipelines(read(text).pipelines, Context(floors=floors), {})
    assert a.fingerprint is not None
    assert b.fingerprint is not None
    assert a.fingerprint.algorithm is b.fingerprint.algorithm
    within = a.filter.algorithm.context
    assert set(within.maps) == {"F1", "F2"}
    assert within.fingerprint is a.fingerprint.algorithm


def test_an_algorithm_that_cannot_be_built_is_named_with_its_pipeline() -> None:
    config = read('[pipelines.a]\nfingerprint = "near"\nfilter = "last"\nmap = "plain"\n')
    with pytest.raises(PluginError, match="map 'plain' in pipeline 'a': cannot be built: ValueError: it is dark"):
        build_pipelines(config.pipelines, Context(floors={"attic": Floor(name="attic")}), {})


def test_parameters_are_described_for_people() -> None:
    k, reach, mode, mirror = describe_parameters(Near)
    assert (k.name, k.type, k.default, k.doc, k.trains) == ("k", "integer ≥ 1 and ≤ 9", 5, "neighbours", True)
    assert (reach.unit, reach.source, reach.type) == ("m", "eq. (1)", "number > 0")
    assert mode.type == "one of 'a', 'b'"
    assert (mirror.type, mirror.doc) == ("true or false", "")


def test_only_keeps_the_order_of_the_file_and_knows_the_names() -> None:
    text = "".join(f'[pipelines.{name}]\nfingerprint = "near"\nfilter = "last"\n' for name in ("one", "two", "three"))
    assert [p.name for p in read(text).only(["three", "one"]).pipelines] == ["one", "three"]
    with pytest.raises(ConfigError, match=r"--pipeline: found 'tree'; expected one of .*did you mean 'three'"):
        read(text).only(["tree"])


def test_a_file_that_is_not_there_is_an_error_of_the_configuration(tmp_path: Any) -> None:
    with pytest.raises(ConfigError, match=r"none.toml: found no readable file"):
        load_config(tmp_path / "none.toml", REGISTRY)


@dataclass(frozen=True)
class Places:
    """Settings with a path."""

    keys: Path | None = None


def test_a_section_takes_a_path_as_text_and_names_what_is_none() -> None:
    text = '[pipelines.a]\nfingerprint = "near"\nfilter = "last"\n[ports]\nkeys = '
    assert read(f'{text}"a/b"').section("ports", Places) == Places(Path("a/b"))
    with pytest.raises(ConfigError, match=r"ports.keys: found 3; expected Path or nothing"):
        read(f"{text}3").section("ports", Places)
