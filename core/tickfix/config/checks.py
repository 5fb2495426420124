"""Checks of what stands in a file: known keys, and values of the right type."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from tickfix.api.errors import ConfigError
from tickfix.config.words import one_of, type_words


def check_keys(where: str, owner: str, table: Mapping[str, Any], known: Iterable[str]) -> None:
    """Refuse keys that are not known.

    Args:
        where: file and key of the table, for errors.
        owner: whose keys they are, for errors; may be empty.
        table: as it stands in the file.
        known: the keys there are.

    Raises:
        ConfigError: naming the first unknown key and the known one nearest to it.
    """
    names = list(known)
    for key in table:
        if key not in names:
            whose = f" of {owner}" if owner else ""
            raise ConfigError(
                f"{where}{'.' if ': ' in where else ': '}{key}", f"an unknown key{whose}", one_of(names, key)
            )


def convert(where: str, value: Any, kind: type[Any]) -> Any:
    """Return a value of the file as the type that is asked for; a text becomes a path where that is a path.

    Raises:
        ConfigError: naming the value found and what is allowed.
    """
    try:
        return msgspec.convert(value, kind, dec_hook=_path)
    except msgspec.ValidationError as error:
        raise ConfigError(where, repr(value), type_words(kind)) from error


def _path(kind: type[Any], value: Any) -> Path:
    """Convert what msgspec knows nothing of: paths are texts."""
    if kind is not Path or not isinstance(value, str):
        raise msgspec.ValidationError
    return Path(value)
