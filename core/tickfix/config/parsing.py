"""TOML → :class:`~tickfix.config.Config`.

A pipeline names its stages; parameters stand beside the name::

    [pipelines.fusion]
    pdr         = "steps"
    fingerprint = { use = "wknn", k = 5 }
    filter      = { use = "fusion-pf", preset = "jiang2015", particles = 500 }
    map         = "walls"

A list where a parameter takes one value makes several pipelines of one, see :mod:`tickfix.config.sweep`.
"""

from __future__ import annotations

import json
import tomllib
import typing
from collections.abc import Mapping
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import msgspec

from tickfix.api.errors import ConfigError, PluginError
from tickfix.config.checks import check_keys, convert
from tickfix.config.choices import Choice, Config, PipelineConfig
from tickfix.config.parameters import describe
from tickfix.config.sweep import expand
from tickfix.config.words import one_of
from tickfix.kernel import KernelSettings
from tickfix.plugins import Registry

STAGES: Final = ("pdr", "fingerprint", "filter", "map")
_SETTINGS: Final = {"seed": int, "horizon_s": float, "checkpoint_mb": float}
_SECTIONS: Final = ("live", "ports", "journal")


def load(path: Path | None, registry: Registry) -> Config:
    """Read a configuration; None stands for the one that comes with tickfix.

    Raises:
        ConfigError: naming file, key, value found and what is allowed.
    """
    if path is None:
        return parse(files("tickfix.config").joinpath("default.toml").read_text("utf-8"), "default.toml", registry)
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
    check_keys(where, "", table, [*_SETTINGS, *_SECTIONS, "pipelines"])
    values = {}
    for name, kind in _SETTINGS.items():
        if name in table:
            values[name] = convert(f"{where}: {name}", table[name], kind)
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


def _pipelines(where: str, name: str, table: Any, registry: Registry) -> list[PipelineConfig]:
    if not isinstance(table, dict):
        raise ConfigError(where, repr(table), f"a table with {', '.join(STAGES)}")
    check_keys(where, "", table, STAGES)
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
            raise ConfigError(f"{where}.preset", repr(preset), one_of(list(offer.cls.presets), str(preset)))
        given = {**offer.cls.presets[preset].values, **given}
    return Choice(offer, _params(where, offer.cls, given), preset)


def _params(where: str, cls: type[Any], given: Mapping[str, Any]) -> Any:
    fields = {field.name: field for field in describe(cls)}
    check_keys(where, f"{cls.kind} '{cls.name}'", given, list(fields))
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
