"""A parsed configuration: chosen algorithms with checked parameters, pipelines, and the settings of a run."""

from __future__ import annotations

import dataclasses
import difflib
import json
import types
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeVar

import msgspec

from tickfix.api.errors import ConfigError
from tickfix.kernel import KernelSettings
from tickfix.registry import Offer


def one_of(names: list[str], found: str) -> str:
    """Return ``one of a, b, c``, with a suggestion if one of the names is close to ``found``."""
    near = difflib.get_close_matches(found, names, 1)
    return f"one of {', '.join(names) or 'nothing'}" + (f" (did you mean {near[0]!r}?)" if near else "")


def describe_type(hint: Any) -> str:
    """Return the values that a type hint allows, with bounds and choices: ``integer ≥ 1``, ``one of 'a', 'b'``."""
    if typing.get_origin(hint) is typing.Annotated:
        base, *metas = typing.get_args(hint)
        signs = (("ge", "≥"), ("gt", ">"), ("le", "≤"), ("lt", "<"))
        bounds = [
            f"{sign} {getattr(meta, name):g}"
            for meta in metas
            for name, sign in signs
            if getattr(meta, name, None) is not None
        ]
        return " ".join([describe_type(base), " and ".join(bounds)]).strip()
    if typing.get_origin(hint) is Literal:
        return "one of " + ", ".join(map(repr, typing.get_args(hint)))
    if typing.get_origin(hint) is tuple:
        return f"list of {describe_type(typing.get_args(hint)[0])}"
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        return " or ".join(describe_type(arg) for arg in typing.get_args(hint))
    names = {int: "integer", float: "number", str: "string", bool: "true or false", type(None): "nothing"}
    return names.get(hint, getattr(hint, "__name__", str(hint)))


@dataclass(frozen=True, slots=True)
class ParameterInfo:
    """A parameter as help texts show it.

    Attributes:
        formerly: its name in an earlier release; empty if it was never renamed.
    """

    name: str
    type: str
    default: Any
    doc: str
    unit: str
    source: str
    trains: bool
    formerly: str


def describe_parameters(cls: type[Any]) -> tuple[ParameterInfo, ...]:
    """Return the parameters of an algorithm in their order."""
    hints = typing.get_type_hints(cls.Params, include_extras=True)
    fields = []
    for each in dataclasses.fields(cls.Params):
        hint = hints[each.name]
        meta = _field_meta(hint)
        extra = meta.extra or {}
        default = each.default_factory() if each.default_factory is not dataclasses.MISSING else each.default
        fields.append(
            ParameterInfo(
                each.name,
                describe_type(hint),
                default,
                meta.description or "",
                extra.get("unit", ""),
                extra.get("source", ""),
                extra.get("trains", False),
                extra.get("formerly", ""),
            )
        )
    return tuple(fields)


def former_names(hints: Mapping[str, Any]) -> dict[str, str]:
    """Return old name → new name of the fields that were renamed.

    Args:
        hints: the type hints of a dataclass with their extras; a renamed field carries ``parameter(formerly=…)``.
    """
    formerly = {name: (_field_meta(hint).extra or {}).get("formerly", "") for name, hint in hints.items()}
    return {old: name for name, old in formerly.items() if old}


def _field_meta(hint: Any) -> msgspec.Meta:
    return next((m for m in getattr(hint, "__metadata__", ()) if isinstance(m, msgspec.Meta)), msgspec.Meta())


class RenamedKeyError(ConfigError):
    """A key that an earlier release had under another name.

    Args:
        where: file and renamed key, such as ``mine.toml: pipelines.b.filter.own_ways``.
        new_name: the key that replaces it.
    """

    kind: ClassVar[str] = "config_renamed"

    def __init__(self, where: str, new_name: str) -> None:
        super().__init__(where, "a renamed key", new_name)
        self.args = (f"{where}: renamed, use {new_name}",)

    def __reduce__(self) -> tuple[type[RenamedKeyError], tuple[str, str]]:
        """Pickle by the constructor's arguments, so that a worker process can raise it in its parent."""
        return type(self), (self.where, self.expected)


def check_keys(
    where: str, owner: str, table: Mapping[str, Any], known: Iterable[str], renamed: Mapping[str, str] | None = None
) -> None:
    """Refuse keys that are not known.

    Args:
        where: file and key of the table, for errors.
        owner: whose keys they are, for errors; may be empty.
        table: as it stands in the file.
        known: the keys there are.
        renamed: old name → new name of keys that an earlier release had.

    Raises:
        ConfigError: naming the first unknown key, and its new name or the known one nearest to it.
    """
    names = list(known)
    for key in table:
        if key not in names:
            at = f"{where}{'.' if ': ' in where else ': '}{key}"
            if renamed and key in renamed:
                raise RenamedKeyError(at, renamed[key])
            whose = f" of {owner}" if owner else ""
            raise ConfigError(at, f"an unknown key{whose}", one_of(names, key))


def convert_value(where: str, value: Any, kind: type[Any]) -> Any:
    """Return a value of the file converted to ``kind``; a string becomes a path where ``kind`` is a path.

    Raises:
        ConfigError: naming the value found and what is allowed.
    """
    try:
        return msgspec.convert(value, kind, dec_hook=_path_dec_hook)
    except msgspec.ValidationError as error:
        raise ConfigError(where, repr(value), describe_type(kind)) from error


def _path_dec_hook(kind: type[Any], value: Any) -> Path:
    """Convert a type that msgspec does not know: a path is written as a string."""
    if kind is not Path or not isinstance(value, str):
        raise msgspec.ValidationError
    return Path(value)


T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class BuiltAlgorithm:
    """An algorithm that was built by the caller and is used as it is.

    Attributes:
        algorithm: the object.
        number: tells objects of equal class and parameters apart in keys; an ``id`` would differ from run to run.
    """

    algorithm: Any
    number: int


@dataclass(frozen=True, slots=True)
class AlgorithmChoice:
    """An algorithm of a pipeline, with its parameters checked.

    Attributes:
        offer: the class and where it comes from.
        params: an instance of the class's ``Params``.
        preset: name of the preset that ``params`` were taken from, empty without one.
        built: the object to use instead of building one; None for algorithms chosen by name or class.
    """

    offer: Offer
    params: Any
    preset: str = ""
    built: BuiltAlgorithm | None = None

    @property
    def key(self) -> str:
        """Equal for choices that compute the same results."""
        suffix = "" if self.built is None else f" (object {self.built.number})"
        return f"{self.offer.label} {json.dumps(msgspec.to_builtins(self.params), sort_keys=True)}{suffix}"

    @property
    def model(self) -> str:
        """Name of the model trained for it: a hash over the parameters that are marked ``trains=True`` only."""
        trains = {
            field.name: getattr(self.params, field.name)
            for field in describe_parameters(self.offer.cls)
            if field.trains
        }
        digest = sha256(json.dumps(msgspec.to_builtins(trains), sort_keys=True).encode()).hexdigest()[:12]
        return f"{self.offer.kind}-{self.offer.name}-{digest}"


@dataclass(frozen=True, slots=True)
class PipelineConfig:
    """A named choice of stages.

    Attributes:
        name: unique in a configuration; pipelines of a sweep have the swept values in brackets.
        filter, pdr, fingerprint, map: the chosen algorithms; None for a stage that the pipeline leaves out.
        table: the name in the file, which several pipelines of a sweep share.
        swept: the parameters that vary within a sweep, with this pipeline's values.
    """

    name: str
    filter: AlgorithmChoice
    pdr: AlgorithmChoice | None = None
    fingerprint: AlgorithmChoice | None = None
    map: AlgorithmChoice | None = None
    table: str = ""
    swept: tuple[tuple[str, Any], ...] = ()

    @property
    def choices(self) -> tuple[AlgorithmChoice, ...]:
        """The stages that the pipeline has, in the order in which they run."""
        return tuple(c for c in (self.pdr, self.fingerprint, self.filter, self.map) if c is not None)


@dataclass(frozen=True, slots=True)
class Config:
    """The contents of a configuration file, checked.

    Attributes:
        kernel: settings of every run.
        pipelines: in the order of the file.
        sections: tables that higher layers interpret (``[live]``, ``[ports]``, ``[journal]``), unchecked; see
            :meth:`section`.
        where: names the file in errors.
        text: the file's text, kept for the manifest of a run.
    """

    kernel: KernelSettings
    pipelines: tuple[PipelineConfig, ...]
    sections: Mapping[str, Any] = field(default_factory=dict)
    where: str = ""
    text: str = ""

    def section(self, name: str, cls: type[T]) -> T:
        """Return the settings of the table ``[name]`` as ``cls``, a dataclass; missing keys take its defaults.

        Raises:
            ConfigError: naming file, key, value found and what is allowed.
        """
        table, where = self.sections.get(name, {}), f"{self.where}: {name}"
        if not isinstance(table, dict):
            raise ConfigError(where, repr(table), f"a table [{name}]")
        hints = typing.get_type_hints(cls, include_extras=True)
        check_keys(where, "", table, list(hints), former_names(hints))
        values = {key: convert_value(f"{where}.{key}", value, hints[key]) for key, value in table.items()}
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
                raise ConfigError("--pipeline", repr(name), one_of(known, name))
        return replace(self, pipelines=tuple(p for p in self.pipelines if p.name in wanted or p.table in wanted))
