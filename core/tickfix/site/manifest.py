"""``site.json``: what the folder of a site holds, apart from arrays and geometry."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import msgspec

from tickfix.api import SiteError

FORMAT: Final = 1
"""Version of the folder's layout; changes when an older tickfix could no longer read it."""

NAME: Final = "site.json"


class FloorEntry(msgspec.Struct, frozen=True, kw_only=True):
    """A floor; ``file`` is its GeoJSON relative to the site."""

    name: str
    level: int
    width_m: float
    height_m: float
    file: str


class HeldOutEntry(msgspec.Struct, frozen=True, kw_only=True):
    """A held-out walk; the relative path counts from the site folder and is tried first."""

    walk: str
    floor: str
    chain: str
    path: str | None
    relative_path: str | None
    sha256: str


class ModelEntry(msgspec.Struct, frozen=True, kw_only=True):
    """A trained model; ``file`` is relative to the site."""

    key: str
    file: str


class Manifest(msgspec.Struct, frozen=True, kw_only=True):
    """The whole of ``site.json``."""

    format: int
    tickfix: str
    name: str
    floors: list[FloorEntry]
    held_out: list[HeldOutEntry]
    models: list[ModelEntry]
    notes: dict[str, int]


class _Format(msgspec.Struct, frozen=True):
    format: int
    tickfix: str = "an unknown version"


def save_manifest(folder: Path, manifest: Manifest) -> None:
    """Write ``site.json`` into ``folder``."""
    (folder / NAME).write_bytes(msgspec.json.format(msgspec.json.encode(manifest), indent=2) + b"\n")


def load_manifest(folder: Path) -> Manifest:
    """Read ``site.json`` of ``folder``.

    Raises:
        SiteError: when it is missing, of another format, or not what it should be.
    """
    path = folder / NAME
    try:
        data = path.read_bytes()
    except OSError:
        raise SiteError(f"{folder}: found no {NAME}, so this is no site; make one with `tickfix survey`") from None
    try:
        found = msgspec.json.decode(data, type=_Format)
        if found.format != FORMAT:
            raise SiteError(
                f"{path}: found format {found.format} (written by tickfix {found.tickfix}), expected {FORMAT}; "
                "survey again with this version of tickfix"
            )
        return msgspec.json.decode(data, type=Manifest)
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise SiteError(f"{path}: {error}; undo the last edit or survey again") from error


def is_site(folder: Path) -> bool:
    """Tell whether ``folder`` is a site of any format."""
    try:
        msgspec.json.decode((folder / NAME).read_bytes(), type=_Format)
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError):
        return False
    return True
