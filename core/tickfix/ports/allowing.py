"""Changes to the allow-list: whole entries come and go, and what people wrote around them stays."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any, Final

from tickfix.api.errors import PortError
from tickfix.ports.keys import ALLOWED, Grant, read_grants

_HEAD: Final = "[[allow]]"


def allow(folder: Path, grant: Grant) -> Path:
    """Add an entry to the allow-list in ``folder``; return the list's file. A running engine sees it in a second.

    Raises:
        PortError: when name or key stand there already, or a value cannot be.
    """
    file = folder / ALLOWED
    text = file.read_text("utf-8") if file.exists() else ""
    lines = [_HEAD, *(f"{field} = {json.dumps(value, ensure_ascii=False)}" for field, value in _fields(grant).items())]
    _replace(file, text + ("\n" if text.strip() else "") + "\n".join(lines) + "\n")
    return file


def withdraw(folder: Path, name: str) -> None:
    """Take an entry off the allow-list; a running engine sees it in a second.

    Raises:
        PortError: when there is none of this name.
    """
    file = folder / ALLOWED
    names = [grant.name for grant in read_grants(file)]
    if name not in names:
        raise PortError(f"{file}: found no key named {name!r}; it has {', '.join(names) or 'none'}")
    blocks: list[str] = [""]
    for line in file.read_text("utf-8").splitlines(keepends=True):
        if line.split("#")[0].strip() == _HEAD:
            blocks.append("")
        blocks[-1] += line
    kept = [block for block in blocks if not any(entry["name"] == name for entry in _entries(block))]
    _replace(file, "".join(kept))


def _entries(block: str) -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = tomllib.loads(block).get("allow", [])
    return entries


def _fields(grant: Grant) -> dict[str, Any]:
    fields = {field: getattr(grant, field) for field in grant.__struct_fields__}
    return {field: list(value) if isinstance(value, tuple) else value for field, value in fields.items() if value}


def _replace(file: Path, text: str) -> None:
    """Put ``text`` in the place of the file, at once and only if it is a good list."""
    new = file.with_suffix(".new")
    new.write_text(text, "utf-8")
    try:
        read_grants(new)
    except PortError as error:
        new.unlink()
        raise PortError(str(error).replace(str(new), str(file))) from error
    new.replace(file)
