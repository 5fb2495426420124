"""TOML → :class:`~tickfix.config.Config`.

A pipeline names its stages; parameters stand beside the name::

    [pipelines.fusion]
    pdr         = "steps"
    fingerprint = { use = "wknn", k = 5 }
    filter      = { use = "fusion-pf", preset = "jiang2015", particles = 500 }
    map         = "walls"

A list where a parameter takes one value is a sweep, and makes one pipeline of each value: with ``k = [3, 5]`` and
``particles = [100, 500]`` there are ``fusion[k=3, particles=100]``, ``fusion[k=3, particles=500]`` and so on. A
parameter that itself is a list is swept by a list of lists."""

from __future__ import annotations

import json
import tomllib
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from itertools import product
from pathlib import Path
from typing import Any, Final

import msgspec

from tickfix.api.errors import ConfigError, PluginError
from tickfix.config.choices import (
    AlgorithmChoice,
    Config,
    PipelineConfig,
    check_keys,
    convert_value,
    describe_parameters,
    former_names,
    one_of,
)
from tickfix.kernel import KernelSettings
from tickfix.registry import Registry

MAX_SWEEP_PIPELINES: Final = 1000
"""Pipelines that one table may expand to."""

_RESERVED_KEYS: Final = ("use", "preset")


@dataclass(frozen=True, slots=True)
class SweepVariant:
    """A pipeline of a sweep.

    Attributes:
        name: the table's, with the swept values in brackets where there are any.
        stages: the table with one value for each parameter.
        swept: the parameters that vary, with this variant's values.
    """

    name: str
    stages: Mapping[str, Any]
    swept: tuple[tuple[str, Any], ...] = ()


def expand_sweep(where: str, name: str, stages: Mapping[str, Any], registry: Registry) -> tuple[SweepVariant, ...]:
    """Return the pipelines that a table stands for: itself, if no parameter is swept.

    Args:
        where: file and key, for errors.
        name: of the table.
        stages: as they stand in the file, not checked yet.
        registry: to look up what parameters take.

    Raises:
        ConfigError: for an empty list, a value given twice, or too many pipelines.
    """
    axes = [
        (kind, key, values)
        for kind, table in stages.items()
        if isinstance(table, dict)
        for key, values in table.items()
        if key not in _RESERVED_KEYS and _is_swept(kind, table, key, values, registry)
    ]
    count = 1
    for kind, key, values in axes:
        if not values or any(value in values[:i] for i, value in enumerate(values)):
            raise ConfigError(f"{where}.{kind}.{key}", repr(values), "values to sweep over, each once")
        count *= len(values)
    if count > MAX_SWEEP_PIPELINES:
        raise ConfigError(where, f"a sweep of {count} pipelines", f"at most {MAX_SWEEP_PIPELINES}")
    keys = [key for _, key, _ in axes]
    labels = [key if keys.count(key) == 1 else f"{kind}.{key}" for kind, key, _ in axes]
    return tuple(_sweep_variant(name, stages, axes, labels, values) for values in product(*(axis[2] for axis in axes)))


def _sweep_variant(
    name: str,
    stages: Mapping[str, Any],
    axes: Sequence[tuple[str, str, list[Any]]],
    labels: Sequence[str],
    values: Sequence[Any],
) -> SweepVariant:
    chosen = {kind: dict(table) if isinstance(table, dict) else table for kind, table in stages.items()}
    for (kind, key, _), value in zip(axes, values, strict=True):
        chosen[kind][key] = value
    swept = tuple(zip(labels, values, strict=True))
    suffix = ", ".join(f"{label}={value}" for label, value in swept)
    return SweepVariant(f"{name}[{suffix}]" if swept else name, chosen, swept)


def _is_swept(kind: str, table: Mapping[str, Any], key: str, values: Any, registry: Registry) -> bool:
    if not isinstance(values, list):
        return False
    try:
        cls = registry.get(kind, str(table.get("use"))).cls
    except PluginError:
        return False
    hint = typing.get_type_hints(cls.Params).get(key)
    return hint is not None and (not _is_list(hint) or (bool(values) and all(isinstance(v, list) for v in values)))


def _is_list(hint: Any) -> bool:
    """Return whether a parameter's type is a list, or may be one."""
    origin = typing.get_origin(hint)
    return origin in (tuple, list) or hint in (tuple, list) or any(_is_list(arg) for arg in typing.get_args(hint))


STAGES: Final = ("pdr", "fingerprint", "filter", "map")
_KERNEL_KEYS: Final = {"seed": int, "horizon_s": float, "checkpoint_mb": float}
_OTHER_SECTIONS: Final = ("live", "ports", "journal")


def load_config(path: Path | None, registry: Registry) -> Config:
    """Read a configuration; None stands for the one that comes with tickfix.

    Raises:
        ConfigError: naming file, key, value found and what is allowed.
    """
    if path is None:
        return parse_config(
            files("tickfix.config").joinpath("default.toml").read_text("utf-8"), "default.toml", registry
        )
    try:
        text = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(str(path), f"no readable file ({error})", "a TOML file") from error
    return parse_config(text, str(path), registry)


def parse_config(text: str, where: str, registry: Registry) -> Config:
    """Parse a configuration; ``where`` names it in errors."""
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(where, str(error), "valid TOML") from error
    return parse_table(table, where, registry, text=text)


def parse_table(table: Mapping[str, Any], where: str, registry: Registry, *, text: str = "") -> Config:
    """Check a configuration given as nested dictionaries.

    Args:
        table: as :mod:`tomllib` gives it; a stage may also be an :class:`~tickfix.config.choices.AlgorithmChoice`.
        where: names it in errors.
        registry: the algorithms that it may choose.
        text: the file that it was read from, if any.

    Raises:
        ConfigError: naming key, value found and what is allowed.
    """
    check_keys(where, "", table, [*_KERNEL_KEYS, *_OTHER_SECTIONS, "pipelines"])
    values = {}
    for name, kind in _KERNEL_KEYS.items():
        if name in table:
            values[name] = convert_value(f"{where}: {name}", table[name], kind)
            if values[name] < 0 or (name != "seed" and values[name] == 0):
                raise ConfigError(f"{where}: {name}", repr(table[name]), "a number > 0")
    pipelines = table.get("pipelines", {})
    if not isinstance(pipelines, dict) or not pipelines:
        raise ConfigError(f"{where}: pipelines", repr(pipelines), "at least one table [pipelines.NAME]")
    checked: dict[str, PipelineConfig] = {}
    for name, stages in pipelines.items():
        for pipeline in _parse_pipelines(f"{where}: pipelines.{name}", name, stages, registry):
            if pipeline.name in checked:
                raise ConfigError(f"{where}: pipelines", f"two pipelines called {pipeline.name!r}", "different names")
            checked[pipeline.name] = pipeline
    return Config(
        KernelSettings(**values),
        tuple(checked.values()),
        sections={name: table[name] for name in _OTHER_SECTIONS if name in table},
        where=where,
        text=text,
    )


def _parse_pipelines(where: str, name: str, table: Any, registry: Registry) -> list[PipelineConfig]:
    if not isinstance(table, dict):
        raise ConfigError(where, repr(table), f"a table with {', '.join(STAGES)}")
    check_keys(where, "", table, STAGES)
    variants = expand_sweep(where, name, table, registry)
    return [replace(_parse_pipeline(where, v.name, v.stages, registry), table=name, swept=v.swept) for v in variants]


def _parse_pipeline(where: str, name: str, table: Mapping[str, Any], registry: Registry) -> PipelineConfig:
    choices: dict[str, Any] = {
        kind: _parse_choice(f"{where}.{kind}", kind, table[kind], registry) for kind in STAGES if kind in table
    }
    if "filter" not in choices:
        raise ConfigError(where, "no filter", 'filter = { use = "NAME" }')
    if "pdr" not in choices and "fingerprint" not in choices:
        raise ConfigError(
            where, "neither pdr nor fingerprint", "at least one of them: a filter alone has nothing to fold"
        )
    return PipelineConfig(name, **choices)


def _parse_choice(where: str, kind: str, table: Any, registry: Registry) -> AlgorithmChoice:
    if isinstance(table, AlgorithmChoice):
        return table
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
            raise ConfigError(f"{where}.preset", repr(preset), one_of(list(offer.cls.presets), str(preset)))
        given = {**offer.cls.presets[preset].values, **given}
    return AlgorithmChoice(offer, _parse_params(where, offer.cls, given), preset)


def _parse_params(where: str, cls: type[Any], given: Mapping[str, Any]) -> Any:
    fields = {field.name: field for field in describe_parameters(cls)}
    hints = typing.get_type_hints(cls.Params, include_extras=True)
    check_keys(where, f"{cls.kind} '{cls.name}'", given, list(fields), former_names(hints))
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
