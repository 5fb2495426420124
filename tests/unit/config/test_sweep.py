"""A list where a parameter takes one value makes several pipelines of one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import pytest

from tickfix.api import BaseFilter, BaseFingerprint, ConfigError, parameter
from tickfix.api import Stateless as Empty
from tickfix.config import Config, parse_config
from tickfix.registry import Offer, Registry


@dataclass(frozen=True)
class Params:
    """Scalars, a list, and a list that may be absent."""

    k: Annotated[int, parameter("neighbours", ge=1)] = 5
    reach_m: float = 3.0
    mirror: bool = False
    ranges: tuple[float, ...] = (1.0,)
    bins: tuple[int, ...] | None = None


class Near(BaseFingerprint[Params]):
    """A fingerprint that finds nothing."""

    name = "near"
    Params = Params
    State = Empty

    def start(self) -> Empty:
        return Empty()

    def step(self, state: Any, window: Any) -> Any:
        return state, None


class Last(BaseFilter[Params]):
    """A filter that begins nowhere."""

    name = "last"
    Params = Params
    State = Empty

    def start(self, prior: Any, rng: Any) -> None:
        return None

    def step(self, state: Any, motion: Any, observations: Any, rng: Any) -> Any:
        raise NotImplementedError

    def estimate(self, state: Any) -> Any:
        raise NotImplementedError


REGISTRY = Registry(Offer(cls.kind, cls.name, cls, "test", "test", "1") for cls in (Near, Last))


def swept(fingerprint: str, filter_: str = '"last"') -> Config:
    return parse_config(f"[pipelines.a]\nfingerprint = {fingerprint}\nfilter = {filter_}\n", "my.toml", REGISTRY)


def names(config: Config) -> list[str]:
    return [p.name for p in config.pipelines]


def test_one_list_is_one_pipeline_a_value() -> None:
    config = swept('{ use = "near", k = [3, 5], reach_m = 2.5 }')
    assert names(config) == ["a[k=3]", "a[k=5]"]
    chosen = [p.fingerprint for p in config.pipelines]
    assert [c.params for c in chosen if c is not None] == [Params(k=3, reach_m=2.5), Params(k=5, reach_m=2.5)]
    assert [p.swept for p in config.pipelines] == [(("k", 3),), (("k", 5),)]
    assert {p.table for p in config.pipelines} == {"a"}


def test_several_lists_are_their_product_the_last_varying_fastest() -> None:
    config = swept('{ use = "near", k = [3, 5] }', '{ use = "last", mirror = [true, false] }')
    assert names(config) == [
        "a[k=3, mirror=True]",
        "a[k=3, mirror=False]",
        "a[k=5, mirror=True]",
        "a[k=5, mirror=False]",
    ]


def test_a_parameter_of_two_stages_is_named_with_its_stage() -> None:
    config = swept('{ use = "near", k = [1, 2] }', '{ use = "last", k = [3] }')
    assert names(config) == ["a[fingerprint.k=1, filter.k=3]", "a[fingerprint.k=2, filter.k=3]"]


def test_a_parameter_that_is_a_list_is_swept_by_lists_only() -> None:
    (one,) = swept('{ use = "near", ranges = [1.0, 2.0], bins = [4] }').pipelines
    assert one.fingerprint is not None
    assert one.fingerprint.params == Params(ranges=(1.0, 2.0), bins=(4,))
    two = swept('{ use = "near", ranges = [[1.0], [1.0, 2.0]] }').pipelines
    assert [p.fingerprint.params.ranges for p in two if p.fingerprint is not None] == [(1.0,), (1.0, 2.0)]


def test_without_lists_nothing_changes() -> None:
    (one,) = swept('"near"').pipelines
    assert (one.name, one.table, one.swept) == ("a", "a", ())


@pytest.mark.parametrize(
    ("fingerprint", "says"),
    [
        ('{ use = "near", k = [] }', r"my.toml: pipelines.a.fingerprint.k: found \[\]; expected values to sweep"),
        ('{ use = "near", k = [3, 3] }', r"found \[3, 3\]; expected values to sweep over, each once"),
        ('{ use = "near", k = [3, 0] }', r"my.toml: pipelines.a.fingerprint.k: found 0; expected integer ≥ 1"),
        ('{ use = "near", q = [1] }', r"fingerprint.q: found an unknown key"),
        ('{ use = "naer", k = [1] }', r"fingerprint.use: found 'naer'"),
        (f'{{ use = "near", k = {list(range(1, 1002))} }}', "found a sweep of 1001 pipelines; expected at most 1000"),
    ],
)
def test_a_sweep_that_cannot_be_is_refused(fingerprint: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        swept(fingerprint)


def test_a_table_stands_for_its_whole_sweep_on_the_command_line() -> None:
    config = swept('{ use = "near", k = [3, 5] }')
    assert names(config.only(["a"])) == ["a[k=3]", "a[k=5]"]
    assert names(config.only(["a[k=5]"])) == ["a[k=5]"]


def test_two_pipelines_of_one_name_are_refused() -> None:
    text = '[pipelines.a]\nfingerprint = { use = "near", k = [3] }\nfilter = "last"\n'
    text += '[pipelines."a[k=3]"]\nfingerprint = "near"\nfilter = "last"\n'
    with pytest.raises(ConfigError, match=r"two pipelines called 'a\[k=3\]'"):
        parse_config(text, "my.toml", REGISTRY)
