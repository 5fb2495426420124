"""The site as a value (floors, radio map, survey tracks, held-out walks and trained models) and as a folder.

A folder holds JSON, GeoJSON and arrays without pickles; equal sites give equal bytes. ``site.json`` has name, floors,
transitions between them, held-out walks, models and the survey's counts; ``floors/F1.geojson`` the geometry in metres;
``radio_map.npz`` the fields of :class:`tickfix.api.RadioMap`; ``survey_tracks.npz`` walk, floor and chain per track and
its points from ``start`` on in t_ns, xy; ``models/KEY.npz`` the trained models. For the data files see
:mod:`tickfix.site.data_files`.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final
from urllib.parse import quote

import msgspec
import numpy as np
from numpy.typing import NDArray

from tickfix.api import EventError, Floor, RadioMap, SiteError, Transition, frozen
from tickfix.api.site import TransitionKind
from tickfix.site.data_files import (
    load_arrays,
    load_floor,
    load_radio_map,
    load_survey_tracks,
    save_arrays,
    save_floor,
    save_radio_map,
    save_survey_tracks,
)
from tickfix.site.waypoints import SurveyTrack
from tickfix.version import __version__


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOutWalk:
    """A walk kept out of the survey, to be tested on.

    Attributes:
        walk: name of the recording.
        floor: name of the floor, empty for a walk over several.
        chain: name of the first walk of its chain.
        path: the file, absolute; None for a simulated walk.
        sha256: hexadecimal digest of the file; empty for a simulated walk.
    """

    walk: str
    floor: str
    chain: str
    path: Path | None = None
    sha256: str = ""

    def file(self) -> Path:
        """Return the path, after checking that the file is still the one that was held out.

        Raises:
            SiteError: when it is gone or has changed.
        """
        if self.path is None:
            raise SiteError(f"held-out walk {self.walk}: it was simulated and has no file")
        if not self.path.is_file():
            raise SiteError(f"held-out walk {self.walk}: {self.path} is gone; put it back or survey again")
        if file_sha256(self.path) != self.sha256:
            raise SiteError(f"held-out walk {self.walk}: {self.path} has changed since the survey; survey again")
        return self.path


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Site:
    """A building as it was surveyed; ``dataclasses.replace(site, models=…)`` gives one with models.

    Attributes:
        name: of the building.
        floors: in the order of their level and name.
        radio_map: over the floors of that name.
        survey_tracks: where the surveyors walked; ``radio_map.sample_chain`` numbers their chains by name.
        held_out: the walks to test on.
        models: trained models: key → name → array.
        notes: what the survey counted.
        transitions: stairs, lifts and escalators between the floors.
    """

    name: str
    floors: tuple[Floor, ...]
    radio_map: RadioMap
    survey_tracks: tuple[SurveyTrack, ...] = ()
    held_out: tuple[HeldOutWalk, ...] = ()
    models: Mapping[str, Mapping[str, NDArray[Any]]] = field(default_factory=lambda: MappingProxyType({}))
    notes: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    transitions: tuple[Transition, ...] = ()

    def __post_init__(self) -> None:
        """Freeze models and notes.

        Raises:
            SiteError: when two floors share a name, or a transition leads to a floor that there is not.
        """
        names = [floor.name for floor in self.floors]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise SiteError(f"site {self.name!r}: found several floors called {', '.join(twice)}; names must be unique")
        for transition in self.transitions:
            if unknown := [name for name in transition.floors if name not in names]:
                found = f"a transition ({transition.kind}) to {', '.join(map(repr, unknown))}"
                raise SiteError(f"site {self.name!r}: found {found}; its floors are {', '.join(names)}")
        models = {
            key: MappingProxyType({name: frozen(array, np.asarray(array).dtype) for name, array in model.items()})
            for key, model in sorted(self.models.items())
        }
        object.__setattr__(self, "models", MappingProxyType(models))
        object.__setattr__(self, "notes", MappingProxyType(dict(sorted(self.notes.items()))))

    def floor(self, name: str) -> Floor:
        """Return the floor of that name.

        Raises:
            SiteError: when there is none.
        """
        for floor in self.floors:
            if floor.name == name:
                return floor
        known = ", ".join(floor.name for floor in self.floors) or "no floors at all"
        raise SiteError(f"site {self.name!r}: found no floor {name!r}; it has {known}")

    @staticmethod
    def load(path: str | os.PathLike[str]) -> Site:
        """Read the site in the folder ``path``, as :func:`load_site` does."""
        return load_site(Path(path))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the site to the folder ``path``, as :func:`save_site` does."""
        save_site(self, Path(path))


def file_sha256(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits."""
    return sha256(path.read_bytes()).hexdigest()


SITE_FORMAT: Final = 1
"""Version of the folder's layout; changes when an older tickfix could no longer read it."""

MANIFEST_FILE: Final = "site.json"


class FloorEntry(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A floor; ``file`` is its GeoJSON relative to the site."""

    name: str
    level: int
    width_m: float
    height_m: float
    file: str
    elevation_m: float | None = None


class TransitionEntry(msgspec.Struct, frozen=True, kw_only=True):
    """Stairs, a lift or an escalator; ``areas`` are rings, or single points, in metres on the floors of that order."""

    kind: TransitionKind
    floors: tuple[str, str]
    areas: tuple[list[tuple[float, float]], list[tuple[float, float]]]


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


class SiteManifest(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The whole of ``site.json``; what most sites do not have is left out."""

    format: int
    tickfix: str
    name: str
    floors: list[FloorEntry]
    held_out: list[HeldOutEntry]
    models: list[ModelEntry]
    notes: dict[str, int]
    transitions: list[TransitionEntry] = []


class _FormatHeader(msgspec.Struct, frozen=True):
    format: int
    tickfix: str = "an unknown version"


def save_manifest(folder: Path, manifest: SiteManifest) -> None:
    """Write ``site.json`` into ``folder``."""
    (folder / MANIFEST_FILE).write_bytes(msgspec.json.format(msgspec.json.encode(manifest), indent=2) + b"\n")


def load_manifest(folder: Path) -> SiteManifest:
    """Read ``site.json`` of ``folder``.

    Raises:
        SiteError: when it is missing, of another format, or not what it should be.
    """
    path = folder / MANIFEST_FILE
    try:
        data = path.read_bytes()
    except OSError:
        raise SiteError(
            f"{folder}: found no {MANIFEST_FILE}, so this is no site; make one with `tickfix survey`"
        ) from None
    try:
        found = msgspec.json.decode(data, type=_FormatHeader)
        if found.format != SITE_FORMAT:
            raise SiteError(
                f"{path}: found format {found.format} (written by tickfix {found.tickfix}), expected {SITE_FORMAT}; "
                "survey again with this version of tickfix"
            )
        return msgspec.json.decode(data, type=SiteManifest)
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise SiteError(f"{path}: {error}; undo the last edit or survey again") from error


def is_site(folder: Path) -> bool:
    """Return whether ``folder`` is a site of any format."""
    try:
        msgspec.json.decode((folder / MANIFEST_FILE).read_bytes(), type=_FormatHeader)
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError):
        return False
    return True


_RADIO_MAP = "radio_map.npz"
_TRACKS = "survey_tracks.npz"


def save_site(site: Site, path: Path) -> None:
    """Write ``site`` to the folder ``path``, as a whole or not at all; a site that was there is replaced.

    Raises:
        SiteError: when something else than a site is there, or the place cannot be written to.
    """
    path = path.absolute()
    if path.exists() and not is_site(path) and not (path.is_dir() and not any(path.iterdir())):
        raise SiteError(f"{path}: found something that is no tickfix site; it is left alone, choose another place")
    draft = path.with_name(f".{path.name}.{os.getpid()}.new")
    old = path.with_name(f".{path.name}.{os.getpid()}.old")
    try:
        draft.mkdir(parents=True)
        _write_files(site, draft, path)
        if path.exists():
            path.rename(old)
        draft.rename(path)
    except OSError as error:
        if old.exists() and not path.exists():
            old.rename(path)
        raise SiteError(f"{path}: cannot be written: {error}") from error
    finally:
        shutil.rmtree(draft, ignore_errors=True)
        shutil.rmtree(old, ignore_errors=True)


def load_site(path: Path) -> Site:
    """Read the site in the folder ``path``.

    Raises:
        SiteError: naming the file that is missing or damaged, what was found there and the remedy.
    """
    path = path.absolute()
    manifest = load_manifest(path)
    return Site(
        name=manifest.name,
        floors=tuple(
            load_floor(
                path / f.file,
                name=f.name,
                level=f.level,
                width_m=f.width_m,
                height_m=f.height_m,
                elevation_m=f.elevation_m,
            )
            for f in manifest.floors
        ),
        radio_map=load_radio_map(path / _RADIO_MAP),
        survey_tracks=load_survey_tracks(path / _TRACKS),
        held_out=tuple(_held_out_from_entry(entry, path) for entry in manifest.held_out),
        models={entry.key: load_arrays(path / entry.file) for entry in manifest.models},
        notes=manifest.notes,
        transitions=tuple(_transition_from_entry(path, entry) for entry in manifest.transitions),
    )


def _transition_from_entry(folder: Path, entry: TransitionEntry) -> Transition:
    first, second = (np.array(area, dtype=np.float64).reshape(-1, 2) for area in entry.areas)
    try:
        return Transition(kind=entry.kind, floors=entry.floors, areas=(first, second))
    except EventError as error:
        raise SiteError(f"{folder / MANIFEST_FILE}: transitions: {error}; undo the last edit") from error


def _transition_entry(transition: Transition) -> TransitionEntry:
    first, second = ([(x, y) for x, y in area.tolist()] for area in transition.areas)
    return TransitionEntry(kind=transition.kind, floors=transition.floors, areas=(first, second))


def _write_files(site: Site, folder: Path, final: Path) -> None:
    floors = [
        FloorEntry(
            name=floor.name,
            level=floor.level,
            width_m=floor.width_m,
            height_m=floor.height_m,
            file=f"floors/{_file_name(floor.name)}.geojson",
            elevation_m=floor.elevation_m,
        )
        for floor in site.floors
    ]
    models = [ModelEntry(key=key, file=f"models/{_file_name(key)}.npz") for key in site.models]
    for name in ("floors", "models"):
        (folder / name).mkdir()
    for floor, entry in zip(site.floors, floors, strict=True):
        save_floor(folder / entry.file, floor)
    for model in models:
        save_arrays(folder / model.file, site.models[model.key])
    save_radio_map(folder / _RADIO_MAP, site.radio_map)
    save_survey_tracks(folder / _TRACKS, site.survey_tracks)
    manifest = SiteManifest(
        format=SITE_FORMAT,
        tickfix=__version__,
        name=site.name,
        floors=floors,
        held_out=[_held_out_entry(held_out, final) for held_out in site.held_out],
        models=models,
        notes=dict(site.notes),
        transitions=[_transition_entry(transition) for transition in site.transitions],
    )
    save_manifest(folder, manifest)


def _file_name(name: str) -> str:
    return quote(name, safe=" ") or "%"


def _held_out_entry(held_out: HeldOutWalk, site: Path) -> HeldOutEntry:
    path = held_out.path
    return HeldOutEntry(
        walk=held_out.walk,
        floor=held_out.floor,
        chain=held_out.chain,
        path=None if path is None else path.as_posix(),
        relative_path=None if path is None else Path(os.path.relpath(path, site)).as_posix(),
        sha256=held_out.sha256,
    )


def _held_out_from_entry(entry: HeldOutEntry, site: Path) -> HeldOutWalk:
    candidates = [Path(os.path.normpath(site / entry.relative_path))] if entry.relative_path is not None else []
    candidates += [Path(entry.path)] if entry.path is not None else []
    there = [path for path in candidates if path.is_file()] or candidates[-1:]
    return HeldOutWalk(
        walk=entry.walk,
        floor=entry.floor,
        chain=entry.chain,
        path=there[0] if there else None,
        sha256=entry.sha256,
    )
