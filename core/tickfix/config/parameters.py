"""The parameters of an algorithm, for people to read."""

from __future__ import annotations

import dataclasses
import typing
from dataclasses import dataclass
from typing import Any

import msgspec

from tickfix.config.words import type_words


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
                type_words(hint),
                default,
                meta.description or "",
                extra.get("unit", ""),
                extra.get("source", ""),
                extra.get("trains", False),
            )
        )
    return tuple(fields)
