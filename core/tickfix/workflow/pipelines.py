"""Understands every way of naming pipelines: names, TOML files, dictionaries, and algorithms of one's own."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, is_dataclass, replace
from functools import cache
from os import PathLike
from pathlib import Path
from typing import Any, Final, TypeAlias

from tickfix.api import ConfigError, NoParams
from tickfix.api.hooks import check_algorithm_class
from tickfix.config import STAGES, AlgorithmChoice, BuiltAlgorithm, Config, PipelineConfig, load_config, parse_table
from tickfix.registry import Offer, Registry, discover

PipelineSpec: TypeAlias = str | PathLike[str] | Mapping[str, Any] | Config | Sequence[Any] | type[Any] | Any | None
"""What stands for pipelines, see :func:`resolve_pipelines`."""

_WHERE: Final = "pipelines"
_MAX_WARNINGS: Final = 5


class TickfixWarning(UserWarning):
    """Something was left out or failed on the way; the message says what and where."""


def warn_each(problems: Sequence[str]) -> None:
    """Issue a :class:`TickfixWarning` for each of the first problems, and one that counts the others."""
    for problem in problems[:_MAX_WARNINGS]:
        warnings.warn(problem, TickfixWarning, stacklevel=3)
    if len(problems) > _MAX_WARNINGS:
        warnings.warn(f"… and {len(problems) - _MAX_WARNINGS} more problems", TickfixWarning, stacklevel=3)


@cache
def installed() -> Registry:
    """Return what the installed plugins offer; a broken plugin gives a :class:`TickfixWarning` once."""
    registry = discover()
    warn_each([f"plugin {problem}" for problem in registry.problems])
    return registry


def resolve_pipelines(spec: PipelineSpec = None, *, seed: int | None = None, strict: bool = False) -> Config:
    """Return the configuration that ``spec`` stands for.

    Args:
        spec: one of

            - None: tickfix's own pipelines (``wifi``, ``pdr``, ``kalman``, ``fusion``);
            - the name of one of them;
            - a TOML file: a path, or a string that ends in ``.toml``;
            - a dictionary of stages, ``{"pdr": "steps", "fingerprint": {"use": "wknn", "k": 6}, "filter": "kalman"}``;
              a stage is a name, a table, a class, a table whose ``use`` is a class, or an object built already;
            - a dictionary from names to any of these, or one with a table ``pipelines`` as a TOML file has it;
            - an algorithm, class or object: it takes the place of its kind in ``fusion``;
            - a :class:`~tickfix.config.Config`;
            - a sequence of these.
        seed: of all random streams; the configuration's, or 0, by default.
        strict: a stage that fails raises instead of being recorded in the estimates.

    Raises:
        ConfigError: naming what was found and what is allowed.
    """
    config = _Resolver().resolve(spec)
    kernel = replace(config.kernel, strict=strict, seed=config.kernel.seed if seed is None else seed)
    return replace(config, kernel=kernel)


def resolve_pipeline(spec: PipelineSpec, *, seed: int | None = None, strict: bool = False) -> Config:
    """Return the configuration of exactly one pipeline.

    Raises:
        ConfigError: as :func:`resolve_pipelines`, and when ``spec`` stands for several.
    """
    config = resolve_pipelines(spec, seed=seed, strict=strict)
    if len(config.pipelines) != 1:
        names = ", ".join(pipeline.name for pipeline in config.pipelines)
        raise ConfigError("pipeline", f"{len(config.pipelines)} pipelines ({names})", "one; compare runs several")
    return config


@dataclass(slots=True)
class _Resolver:
    """One resolution: numbers objects, and offers classes that no plugin has registered."""

    own: dict[tuple[str, str], Offer] = field(default_factory=dict)
    objects: dict[int, BuiltAlgorithm] = field(default_factory=dict)

    def resolve(self, spec: PipelineSpec) -> Config:
        if isinstance(spec, Config):
            return spec
        if isinstance(spec, str) and not spec.endswith(".toml"):
            return self._default(spec)
        if spec is None or isinstance(spec, (str, PathLike)):
            return load_config(None if spec is None else Path(spec), installed())
        if isinstance(spec, Mapping):
            return self._table(spec)
        if _is_algorithm(spec):
            return self._in_fusion(spec)
        if isinstance(spec, Iterable):
            return self._several(list(spec))
        raise ConfigError(_WHERE, repr(spec), "a name, a TOML file, a dictionary, algorithms, or a list of these")

    def _default(self, name: str) -> Config:
        config = load_config(None, installed())
        known = [pipeline.name for pipeline in config.pipelines]
        if name not in known:
            raise ConfigError(_WHERE, repr(name), f"one of {', '.join(known)}, a file ending in .toml, or a dictionary")
        return config.only([name])

    def _table(self, table: Mapping[str, Any]) -> Config:
        if "pipelines" in table:
            pipelines = {name: self._stages(stages) for name, stages in table["pipelines"].items()}
            return parse_table({**table, "pipelines": pipelines}, _WHERE, self._registry())
        if table and set(table) <= set(STAGES):
            name = _algorithm_name(table.get("filter"))
            return parse_table({"pipelines": {name: self._stages(table)}}, _WHERE, self._registry())
        named = []
        for name, spec in table.items():
            config = self.resolve(spec)
            if len(config.pipelines) != 1:
                raise ConfigError(f"{_WHERE}: {name}", f"{len(config.pipelines)} pipelines", "one for each name")
            named.append(replace(config, pipelines=(replace(config.pipelines[0], name=str(name), table=str(name)),)))
        return _merged(named)

    def _in_fusion(self, algorithm: Any) -> Config:
        fusion = self._default("fusion").pipelines[0]
        kind = str(algorithm.kind)
        stages = {choice.offer.kind: choice for choice in fusion.choices}
        config = self._table({**stages, kind: algorithm})
        return replace(config, pipelines=(replace(config.pipelines[0], name=algorithm.name, table=algorithm.name),))

    def _several(self, specs: list[Any]) -> Config:
        return _merged([self.resolve(spec) for spec in specs])

    def _stages(self, table: Any) -> Any:
        return (
            {kind: self._stage(kind, stage) for kind, stage in table.items()} if isinstance(table, Mapping) else table
        )

    def _stage(self, kind: str, stage: Any) -> Any:
        if isinstance(stage, Mapping):
            plain = {key: _plain(value) for key, value in stage.items()}
            return {**plain, "use": self._offered(kind, plain["use"])} if isinstance(plain.get("use"), type) else plain
        if isinstance(stage, type):
            return {"use": self._offered(kind, stage)}
        return self._built(kind, stage) if _is_algorithm(stage) else stage

    def _offered(self, kind: str, cls: type[Any]) -> str:
        """Offer a class under its own name, before any plugin's of that name, and return the name."""
        offer = _offer_of(kind, cls)
        if self.own.setdefault((kind, offer.name), offer).cls is not cls:
            raise ConfigError(f"{_WHERE}: {kind}", f"two classes called {offer.name!r}", "classes with different names")
        return offer.name

    def _built(self, kind: str, algorithm: Any) -> AlgorithmChoice:
        offer = _offer_of(kind, type(algorithm))
        if kind == "map":
            raise ConfigError(f"{_WHERE}: map", "an object", "a class: one is built for each floor")
        built = self.objects.setdefault(id(algorithm), BuiltAlgorithm(algorithm, len(self.objects) + 1))
        params = getattr(algorithm, "params", None)
        params = params if is_dataclass(params) and not isinstance(params, type) else NoParams()
        return AlgorithmChoice(offer, params, built=built)

    def _registry(self) -> Registry:
        others = [offer for offer in installed().offers if (offer.kind, offer.name) not in self.own]
        return Registry([*self.own.values(), *others])


def _merged(configs: Sequence[Config]) -> Config:
    """Return one configuration with all pipelines; a name that is taken gets a number."""
    if not configs:
        raise ConfigError(_WHERE, "none", "at least one")
    pipelines: dict[str, PipelineConfig] = {}
    for pipeline in (pipeline for config in configs for pipeline in config.pipelines):
        name, number = pipeline.name, 2
        while name in pipelines:
            name, number = f"{pipeline.name}-{number}", number + 1
        pipelines[name] = replace(pipeline, name=name)
    return replace(configs[0], pipelines=tuple(pipelines.values()))


def _offer_of(kind: str, cls: type[Any]) -> Offer:
    try:
        check_algorithm_class(cls)
    except ValueError as error:
        raise ConfigError(f"{_WHERE}: {kind}", repr(cls), f"an algorithm: {error}") from error
    if cls.kind != kind:
        raise ConfigError(f"{_WHERE}: {kind}", f"class {cls.__name__}, a {cls.kind}", f"a {kind}")
    return Offer(kind, cls.name, cls, "python", cls.__module__.partition(".")[0], "")


def _is_algorithm(value: Any) -> bool:
    return not isinstance(value, (str, Mapping)) and getattr(value, "kind", None) in STAGES


def _algorithm_name(stage: Any) -> str:
    if isinstance(stage, AlgorithmChoice):
        return stage.offer.name
    if isinstance(stage, Mapping):
        return _algorithm_name(stage.get("use"))
    return stage if isinstance(stage, str) else str(getattr(stage, "name", "pipeline"))


def _plain(value: Any) -> Any:
    """Return a number of numpy as one of Python, which parameters are checked as."""
    return value.item() if hasattr(value, "dtype") and getattr(value, "shape", None) == () else value
