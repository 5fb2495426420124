"""The public surface of ``tickfix.api`` and ``tickfix.toolkit`` is frozen, and every name in it has a use.

After an intended change write the checked-in text again: ``python tests/unit/api/test_public_surface.py``.
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import pkgutil
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import tickfix.toolkit
from tickfix import api
from tickfix.client.connection import ClientError

ROOT = Path(__file__).parents[3]
SURFACE = Path(__file__).parent / "public_surface.txt"

JUSTIFIED = {
    "API_VERSION": "plugins that support several versions of tickfix compare with it",
    "BatchFilter": "the interface that authors of batched filters annotate with",
    "BatchFingerprint": "the interface that authors of batched fingerprints annotate with",
    "BatchPdr": "the interface that authors of batched dead reckoning annotate with",
    "Reader": "the interface of classes of kind reader",
    "SmoothingFilter": "the interface that authors of smoothing filters annotate with",
    "Sink": "the interface of classes of kind sink",
}
"""Public names that nothing here uses, and why they stay."""


def _members(cls: type[Any]) -> Iterator[str]:
    if dataclasses.is_dataclass(cls):
        yield from (f"  {field.name}: {field.type}" for field in dataclasses.fields(cls))
    for name, member in sorted(vars(cls).items()):
        if name.startswith("_"):
            continue
        function = member.__func__ if isinstance(member, staticmethod | classmethod) else member
        if inspect.isfunction(function):
            yield f"  {name}{inspect.signature(function)}"
        elif isinstance(member, property):
            yield f"  {name} (property)"


def _described(name: str, value: Any) -> Iterator[str]:
    if inspect.isclass(value):
        yield f"class {name}({', '.join(base.__name__ for base in value.__bases__)})"
        yield from _members(value)
    elif inspect.isfunction(value):
        yield f"def {name}{inspect.signature(value)}"
    else:
        yield name


def surface() -> str:
    """Return the public names with fields and signatures, one a line."""
    lines = []
    for name in api.__all__:
        lines += [f"tickfix.api: {line}" for line in _described(name, getattr(api, name))]
    for module in sorted(info.name for info in pkgutil.iter_modules(tickfix.toolkit.__path__, "tickfix.toolkit.")):
        for name, value in sorted(vars(importlib.import_module(module)).items()):
            if not name.startswith("_") and getattr(value, "__module__", None) == module:
                lines += [f"{module}: {line}" for line in _described(name, value)]
    return "\n".join(lines) + "\n"


def test_the_public_surface_is_the_one_that_is_checked_in() -> None:
    found, expected = surface().splitlines(), SURFACE.read_text("utf-8").splitlines()
    added = [f"+ {line}" for line in found if line not in expected]
    removed = [f"- {line}" for line in expected if line not in found]
    assert not added + removed, "\n".join(
        [
            "the public surface changed:",
            *removed,
            *added,
            "What is removed or changed breaks plugins: keep it, or raise API_VERSION. If the change is intended, run",
            "    python tests/unit/api/test_public_surface.py",
            "and say so in CHANGELOG.md.",
        ]
    )


def test_every_public_name_is_used_or_justified() -> None:
    folders = ("plugins", "papers", "examples", "docs", "tests", "core/tickfix/toolkit")
    files = [path for folder in folders for path in (ROOT / folder).rglob("*") if path.suffix in (".py", ".md")]
    words = {word for path in files if path != Path(__file__) for word in re.findall(r"\w+", path.read_text("utf-8"))}
    unused = {name for name in api.__all__ if name not in words}
    assert unused <= set(JUSTIFIED)
    assert set(JUSTIFIED) <= set(api.__all__)


def _family(root: type[Exception]) -> list[type[Exception]]:
    return [root, *(each for cls in root.__subclasses__() for each in _family(cls))]


def test_every_error_has_a_kind_of_its_own() -> None:
    for module in ("config", "journal", "wire", "live.protocol", "ports", "client"):
        importlib.import_module(f"tickfix.{module}")
    for root in (api.TickfixError, ClientError):
        family = [cls for cls in _family(root) if cls.__module__.startswith("tickfix.")]
        kinds = [cls.__dict__.get("kind") for cls in family]
        assert all(isinstance(kind, str) and re.fullmatch(r"[a-z]+(_[a-z]+)*", kind) for kind in kinds), family
        assert len(set(kinds)) == len(kinds)


if __name__ == "__main__":
    SURFACE.write_text(surface(), "utf-8")
