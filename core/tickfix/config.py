"""TOML → typed, validated settings and pipelines.

A pipeline names its stages; parameters stand beside the name::

    [pipelines.fusion]
    pdr         = "steps"
    fingerprint = { use = "wknn", k = 5 }
    filter      = { use = "fusion-pf", preset = "jiang2015", particles = 500 }
    map         = "walls"

A list where a parameter takes one value makes several pipelines of one, see :mod:`tickfix.sweep`.

An error says in which file, under which key, what was found and what is allowed.
"""

from __future__ import annotations

import dataclasses
import difflib
import json
import tomllib
import types
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, Literal, TypeVar

import msgspec

from tickfix.api.algorithms import Trained
from tickfix.api.errors import ConfigError, PluginError
from tickfix.api.site import Context
from tickfix.kernel import KernelSettings, Pipeline, Stage
from tickfix.plugins import Offer, Registry
from tickfix.sweep import expand

STAGES: Final = ("pdr", "fingerprint", "filter", "map")
_SETTINGS: Final = {"seed": int, "horizon_s": float, "checkpoint_mb": float}
_SECTIONS: Final = ("live", "ports", "journal")

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Choice:
    """An algorithm that a pipeline chose, with its parameters checked."""

    offer: Offer
    params: Any
    preset: str = ""

    @property
    def key(self) -> str:
        """Equal for choices that compute the same."""
        return f"{self.offer.label} {json.dumps(msgspec.to_builtins(self.params), sort_keys=True)}"

    @property
    def model(self) -> str:
        """Name of the model trained for it: parameters that training does not depend on do not matter."""
        trains = {field.name: getattr(self.params, field.name) for field in describe(self.offer.cls) if field.trains}
        digest = sha256(json.dumps(msgspec.to_builtins(trains), sort_keys=True).encode()).hexdigest()[:12]
        return f"{self.offer.kind}-{self.offer.name}-{digest}"


@dataclass(frozen=True, slots=True)
class PipelineConfig:
    """A named choice of stages.

    Attributes:
        table: the name in the file, which several pipelines of a sweep share.
        swept: the parameters that vary within a sweep, with this pipeline's values.
    """

    name: str
    filter: Choice
    pdr: Choice | None = None
    fingerprint: Choice | None = None
    map: Choice | None = None
    table: str = ""
    swept: tuple[tuple[str, Any], ...] = ()

    @property
    def choices(self) -> tuple[Choice, ...]:
        """The stages that are there."""
        return tuple(c for c in (self.pdr, self.fingerprint, self.filter, self.map) if c is not None)


@dataclass(frozen=True, slots=True)
class Config:
    """Everything a configuration file says.

    Attributes:
        kernel: settings of every run.
        pipelines: in the order of the file.
        sections: tables that belong to rooms above, as they stand there; see :meth:`section`.
        where: names the file in errors.
        text: the file, so that a run can say what it ran.
    """

    kernel: KernelSettings
    pipelines: tuple[PipelineConfig, ...]
    sections: Mapping[str, Any] = field(default_factory=dict)
    where: str = ""
    text: str = ""

    def section(self, name: str, cls: type[T]) -> T:
        """Return the settings of the table ``[name]``; ``cls`` is a dataclass whose defaults stand where it is silent.

        Raises:
            ConfigError: naming file, key, value found and what is allowed.
        """
        table, where = self.sections.get(name, {}), f"{self.where}: {name}"
        if not isinstance(table, dict):
            raise ConfigError(where, repr(table), f"a table [{name}]")
        hints = typing.get_type_hints(cls, include_extras=True)
        _check_keys(where, "", table, list(hints))
        values = {key: _convert(f"{where}.{key}", value, hints[key]) for key, value in table.items()}
        return cls(**values)

    def only(self, names: Iterable[str]) -> Config:
        """Return the configuration with just the pipelines named, in the order of the file.

        The name of a table stands for all pipelines of its sweep.

        Raises:
            ConfigError: for a name that it does not have.
        """
        wanted = list(names)
        known = [p.name for p in self.pipelines]
        tables = {p.table for p in self.pipelines}
        for name in wanted:
            if name not in known and name not in tables:
                raise ConfigError("--pipeline", repr(name), _one_of(known, name))
        return replace(self, pipelines=tuple(p for p in self.pipelines if p.name in wanted or p.table in wanted))


@dataclass(frozen=True, slots=True)
class Field:
    """A parameter, for people to read."""

    name: str
    type: str
    default: Any
    doc: str
    unit: str
    source: str
    trains: bool


def load(path: Path | None, registry: Registry) -> Config:
    """Read a configuration; None stands for the one that comes with tickfix.

    Raises:
        ConfigError: naming file, key, value found and what is allowed.
    """
    if path is None:
        return parse(files("tickfix").joinpath("default.toml").read_text("utf-8"), "default.toml", registry)
    try:
        text = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(str(path), f"no readable file ({error})", "a TOML file") from error
    return parse(text, str(path), registry)


def parse(text: str, where: str, registry: Registry) -> Config:
    """Parse a configuration; ``where`` names it in errors."""
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(where, str(error), "valid TOML") from error
    _check_keys(where, "", table, [*_SETTINGS, *_SECTIONS, "pipelines"])
    values = {}
    for name, kind in _SETTINGS.items():
        if name in table:
            values[name] = _convert(f"{where}: {name}", table[name], kind)
            if values[name] < 0 or (name != "seed" and values[name] == 0):
                raise ConfigError(f"{where}: {name}", repr(table[name]), "a number > 0")
    pipelines = table.get("pipelines", {})
    if not isinstance(pipelines, dict) or not pipelines:
        raise ConfigError(f"{where}: pipelines", repr(pipelines), "at least one table [pipelines.NAME]")
    checked: dict[str, PipelineConfig] = {}
    for name, stages in pipelines.items():
        for pipeline in _pipelines(f"{where}: pipelines.{name}", name, stages, registry):
            if pipeline.name in checked:
                raise ConfigError(f"{where}: pipelines", f"two pipelines called {pipeline.name!r}", "different names")
            checked[pipeline.name] = pipeline
    return Config(
        KernelSettings(**values),
        tuple(checked.values()),
        sections={name: table[name] for name in _SECTIONS if name in table},
        where=where,
        text=text,
    )


def build(pipelines: Iterable[PipelineConfig], context: Context, models: Mapping[str, Trained]) -> tuple[Pipeline, ...]:
    """Build the algorithms of the pipelines for a site; stages chosen alike are built, and computed, once.

    Args:
        context: the site, without maps and fingerprint.
        models: what was trained when the site was surveyed, by :attr:`Choice.model`.

    Raises:
        PluginError: when an algorithm cannot be built; it names pipeline and stage.
    """
    built: dict[str, Any] = {}

    def make(choice: Choice, within: Context, pipeline: str, suffix: str = "") -> Any:
        key = choice.key + suffix
        if key not in built:
            try:
                built[key] = choice.offer.cls(choice.params, within, models.get(choice.model))
            except Exception as error:
                label = f"{choice.offer.kind} '{choice.offer.name}' in pipeline '{pipeline}'"
                problem = f"cannot be built: {type(error).__name__}: {error}"
                raise PluginError(label, problem, "Check its parameters and the site it is built for") from error
        return built[key]

    def stage(choice: Choice, within: Context, pipeline: str, suffix: str = "") -> Stage:
        return Stage(choice.offer.kind, choice.offer.name, choice.key + suffix, make(choice, within, pipeline, suffix))

    result = []
    for config in pipelines:
        maps: dict[str, Any] = {}
        if config.map is not None:
            for name, floor in context.floors.items():
                maps[name] = make(config.map, replace(context, floor=floor), config.name, f" on {name}")
        fingerprint = None if config.fingerprint is None else stage(config.fingerprint, context, config.name)
        within = replace(
            context,
            maps=types.MappingProxyType(maps),
            fingerprint=None if fingerprint is None else fingerprint.algorithm,
        )
        pdr = None if config.pdr is None else stage(config.pdr, context, config.name)
        suffix = " with " + " and ".join(c.key for c in config.choices if c is not config.filter)
        result.append(Pipeline(config.name, stage(config.filter, within, config.name, suffix), pdr, fingerprint))
    return tuple(result)


def describe(cls: type[Any]) -> tuple[Field, ...]:
    """Return the parameters of an algorithm in their order."""
    hints = typing.get_type_hints(cls.Params, include_extras=True)
    fields = []
    for each in dataclasses.fields(cls.Params):
        hint = hints[each.name]
        metas = [m for m in getattr(hint, "__metadata__", ()) if isinstance(m, msgspec.Meta)]
        meta = metas[0] if metas else msgspec.Meta()
        extra = meta.extra or {}
        default = each.default_factory() if each.default_factory is not dataclasses.MISSING else each.default
        fields.append(
            Field(
                each.name,
                _type_words(hint),
                default,
                meta.description or "",
                extra.get("unit", ""),
                extra.get("source", ""),
                extra.get("trains", False),
            )
        )
    return tuple(fields)


def _pipelines(where: str, name: str, table: Any, registry: Registry) -> list[PipelineConfig]:
    if not isinstance(table, dict):
        raise ConfigError(where, repr(table), f"a table with {', '.join(STAGES)}")
    _check_keys(where, "", table, STAGES)
    variants = expand(where, name, table, registry)
    return [replace(_pipeline(where, v.name, v.stages, registry), table=name, swept=v.swept) for v in variants]


def _pipeline(where: str, name: str, table: Mapping[str, Any], registry: Registry) -> PipelineConfig:
    choices: dict[str, Any] = {
        kind: _choice(f"{where}.{kind}", kind, table[kind], registry) for kind in STAGES if kind in table
    }
    if "filter" not in choices:
        raise ConfigError(where, "no filter", 'filter = { use = "NAME" }')
    if "pdr" not in choices and "fingerprint" not in choices:
        raise ConfigError(
            where, "neither pdr nor fingerprint", "at least one of them: a filter alone has nothing to fold"
        )
    return PipelineConfig(name, **choices)


def _choice(where: str, kind: str, table: Any, registry: Registry) -> Choice:
    if isinstance(table, str):
        table = {"use": table}
    if not isinstance(table, dict) or not isinstance(table.get("use"), str):
        raise ConfigError(where, repr(table), '{ use = "NAME", … }')
    try:
        offer = registry.get(kind, table["use"])
    except PluginError as error:
        raise ConfigError(f"{where}.use", repr(table["use"]), error.fix) from error
    given = {key: value for key, value in table.items() if key not in ("use", "preset")}
    preset = table.get("preset", "")
    if preset:
        if preset not in offer.cls.presets:
            raise ConfigError(f"{where}.preset", repr(preset), _one_of(list(offer.cls.presets), str(preset)))
        given = {**offer.cls.presets[preset].values, **given}
    return Choice(offer, _params(where, offer.cls, given), preset)


def _params(where: str, cls: type[Any], given: Mapping[str, Any]) -> Any:
    fields = {field.name: field for field in describe(cls)}
    _check_keys(where, f"{cls.kind} '{cls.name}'", given, list(fields))
    hints = typing.get_type_hints(cls.Params, include_extras=True)
    values = {}
    for key, value in given.items():
        try:
            values[key] = msgspec.convert(value, hints[key])
        except msgspec.ValidationError as error:
            raise ConfigError(f"{where}.{key}", repr(value), fields[key].type) from error
    try:
        return cls.Params(**values)
    except (ValueError, TypeError) as error:
        raise ConfigError(where, json.dumps(dict(given)), str(error)) from error


def _convert(where: str, value: Any, kind: type[Any]) -> Any:
    try:
        return msgspec.convert(value, kind, dec_hook=_path)
    except msgspec.ValidationError as error:
        raise ConfigError(where, repr(value), _type_words(kind)) from error


def _path(kind: type[Any], value: Any) -> Path:
    """Convert what msgspec knows nothing of: paths are texts."""
    if kind is not Path or not isinstance(value, str):
        raise msgspec.ValidationError
    return Path(value)


def _check_keys(where: str, owner: str, table: Mapping[str, Any], known: Iterable[str]) -> None:
    names = list(known)
    for key in table:
        if key not in names:
            whose = f" of {owner}" if owner else ""
            raise ConfigError(
                f"{where}{'.' if ': ' in where else ': '}{key}", f"an unknown key{whose}", _one_of(names, key)
            )


def _one_of(names: list[str], found: str) -> str:
    near = difflib.get_close_matches(found, names, 1)
    return f"one of {', '.join(names) or 'nothing'}" + (f" (did you mean {near[0]!r}?)" if near else "")


def _type_words(hint: Any) -> str:
    if typing.get_origin(hint) is typing.Annotated:
        base, *metas = typing.get_args(hint)
        signs = (("ge", "≥"), ("gt", ">"), ("le", "≤"), ("lt", "<"))
        bounds = [
            f"{sign} {getattr(meta, name):g}"
            for meta in metas
            for name, sign in signs
            if getattr(meta, name, None) is not None
        ]
        return " ".join([_type_words(base), " and ".join(bounds)]).strip()
    if typing.get_origin(hint) is Literal:
        return "one of " + ", ".join(map(repr, typing.get_args(hint)))
    if typing.get_origin(hint) is tuple:
        return f"list of {_type_words(typing.get_args(hint)[0])}"
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        return " or ".join(_type_words(arg) for arg in typing.get_args(hint))
    names = {int: "integer", float: "number", str: "string", bool: "true or false", type(None): "nothing"}
    return names.get(hint, getattr(hint, "__name__", str(hint)))
