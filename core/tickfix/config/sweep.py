"""Sweeps: where a parameter takes one value and the configuration gives a list, one pipeline stands for several.

::

    [pipelines.fusion]
    fingerprint = { use = "wknn", k = [3, 5] }
    filter      = { use = "fusion-pf", particles = [100, 500] }

becomes ``fusion[k=3, particles=100]``, ``fusion[k=3, particles=500]``, ``fusion[k=5, particles=100]``,
``fusion[k=5, particles=500]``. A parameter that itself is a list is swept by a list of lists.
"""

from __future__ import annotations

import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Final

from tickfix.api.errors import ConfigError, PluginError
from tickfix.plugins import Registry

MOST: Final = 1000
"""Pipelines that one table may expand to."""

_CHOICE: Final = ("use", "preset")


@dataclass(frozen=True, slots=True)
class Variant:
    """A pipeline of a sweep.

    Attributes:
        name: the table's, with the swept values in brackets where there are any.
        stages: the table with one value for each parameter.
        swept: the parameters that vary, with this variant's values.
    """

    name: str
    stages: Mapping[str, Any]
    swept: tuple[tuple[str, Any], ...] = ()


def expand(where: str, name: str, stages: Mapping[str, Any], registry: Registry) -> tuple[Variant, ...]:
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
        if key not in _CHOICE and _sweeps(kind, table, key, values, registry)
    ]
    count = 1
    for kind, key, values in axes:
        if not values or any(value in values[:i] for i, value in enumerate(values)):
            raise ConfigError(f"{where}.{kind}.{key}", repr(values), "values to sweep over, each once")
        count *= len(values)
    if count > MOST:
        raise ConfigError(where, f"a sweep of {count} pipelines", f"at most {MOST}")
    keys = [key for _, key, _ in axes]
    labels = [key if keys.count(key) == 1 else f"{kind}.{key}" for kind, key, _ in axes]
    return tuple(_variant(name, stages, axes, labels, values) for values in product(*(axis[2] for axis in axes)))


def _variant(
    name: str,
    stages: Mapping[str, Any],
    axes: Sequence[tuple[str, str, list[Any]]],
    labels: Sequence[str],
    values: Sequence[Any],
) -> Variant:
    chosen = {kind: dict(table) if isinstance(table, dict) else table for kind, table in stages.items()}
    for (kind, key, _), value in zip(axes, values, strict=True):
        chosen[kind][key] = value
    swept = tuple(zip(labels, values, strict=True))
    told = ", ".join(f"{label}={value}" for label, value in swept)
    return Variant(f"{name}[{told}]" if swept else name, chosen, swept)


def _sweeps(kind: str, table: Mapping[str, Any], key: str, values: Any, registry: Registry) -> bool:
    if not isinstance(values, list):
        return False
    try:
        cls = registry.get(kind, str(table.get("use"))).cls
    except PluginError:
        return False
    hint = typing.get_type_hints(cls.Params).get(key)
    return hint is not None and (not _is_list(hint) or (bool(values) and all(isinstance(v, list) for v in values)))


def _is_list(hint: Any) -> bool:
    """Tell whether a parameter's type is a list, or may be one."""
    origin = typing.get_origin(hint)
    return origin in (tuple, list) or hint in (tuple, list) or any(_is_list(arg) for arg in typing.get_args(hint))
