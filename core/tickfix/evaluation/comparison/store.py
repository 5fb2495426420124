"""Outcomes on disk, one file each, found by what they depend on: an interrupted comparison goes on where it was."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from tickfix.api.packing import pack, unpack
from tickfix.evaluation.comparison.outcome import Outcome

FORMAT: Final = 1
"""Changes with what an outcome holds."""


def key_of(parts: Mapping[str, Any]) -> str:
    """Return the key (64 hex digits) of an outcome that depends on ``parts``, which are values of JSON."""
    return sha256(json.dumps({"format": FORMAT, **parts}, sort_keys=True).encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class Store:
    """A folder of outcomes; several processes may use it at once."""

    folder: Path

    def has(self, key: str) -> bool:
        """Tell whether something is kept under ``key``."""
        return self._path(key).is_file()

    def get(self, key: str) -> Outcome | None:
        """Return the outcome kept under ``key``; None where there is none, or the file is damaged."""
        try:
            return unpack(self._path(key).read_bytes(), Outcome)
        except (OSError, ValueError):
            return None

    def put(self, key: str, outcome: Outcome) -> None:
        """Keep an outcome, as a whole or not at all."""
        path = self._path(key)
        path.parent.mkdir(parents=True, exist_ok=True)
        draft = path.with_name(f".{path.name}.{os.getpid()}")
        draft.write_bytes(pack(outcome))
        draft.replace(path)

    def _path(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key[2:34]}.outcome"
