"""The words in which errors and descriptions say what is allowed."""

from __future__ import annotations

import difflib
import types
import typing
from typing import Any, Literal


def one_of(names: list[str], found: str) -> str:
    """Return ``one of a, b, c``, and the name that was meant if one is near to what was found."""
    near = difflib.get_close_matches(found, names, 1)
    return f"one of {', '.join(names) or 'nothing'}" + (f" (did you mean {near[0]!r}?)" if near else "")


def type_words(hint: Any) -> str:
    """Return what a type hint allows, bounds and choices too: ``integer ≥ 1``, ``one of 'a', 'b'``."""
    if typing.get_origin(hint) is typing.Annotated:
        base, *metas = typing.get_args(hint)
        signs = (("ge", "≥"), ("gt", ">"), ("le", "≤"), ("lt", "<"))
        bounds = [
            f"{sign} {getattr(meta, name):g}"
            for meta in metas
            for name, sign in signs
            if getattr(meta, name, None) is not None
        ]
        return " ".join([type_words(base), " and ".join(bounds)]).strip()
    if typing.get_origin(hint) is Literal:
        return "one of " + ", ".join(map(repr, typing.get_args(hint)))
    if typing.get_origin(hint) is tuple:
        return f"list of {type_words(typing.get_args(hint)[0])}"
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        return " or ".join(type_words(arg) for arg in typing.get_args(hint))
    names = {int: "integer", float: "number", str: "string", bool: "true or false", type(None): "nothing"}
    return names.get(hint, getattr(hint, "__name__", str(hint)))
