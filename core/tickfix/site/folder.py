"""A site on disk: a folder of JSON, GeoJSON and arrays, no pickles.

::

    site.json              name, floors, held-out walks, models, what the survey counted
    floors/F1.geojson      geometry in metres, see :mod:`tickfix.site.floor_file`
    radio_map.npz          the fields of :class:`tickfix.api.RadioMap`
    survey_tracks.npz      walk, floor, chain per track; its points from ``start`` on in t_ns, xy
    models/KEY.npz         trained models

Equal sites give equal bytes.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from urllib.parse import quote

import tickfix
from tickfix.api import SiteError
from tickfix.site.arrays_file import load_arrays, save_arrays
from tickfix.site.floor_file import load_floor, save_floor
from tickfix.site.manifest import (
    FORMAT,
    FloorEntry,
    HeldOutEntry,
    Manifest,
    ModelEntry,
    is_site,
    load_manifest,
    save_manifest,
)
from tickfix.site.site import HeldOut, Site
from tickfix.site.tables import load_radio_map, load_tracks, save_radio_map, save_tracks

_RADIO_MAP = "radio_map.npz"
_TRACKS = "survey_tracks.npz"


def save(site: Site, path: Path) -> None:
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
        _write(site, draft, path)
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


def load(path: Path) -> Site:
    """Read the site in the folder ``path``.

    Raises:
        SiteError: naming the file that is missing or damaged, what was found there and the remedy.
    """
    path = path.absolute()
    manifest = load_manifest(path)
    return Site(
        name=manifest.name,
        floors=tuple(
            load_floor(path / f.file, name=f.name, level=f.level, width_m=f.width_m, height_m=f.height_m)
            for f in manifest.floors
        ),
        radio_map=load_radio_map(path / _RADIO_MAP),
        survey_tracks=load_tracks(path / _TRACKS),
        held_out=tuple(_held_out(entry, path) for entry in manifest.held_out),
        models={entry.key: load_arrays(path / entry.file) for entry in manifest.models},
        notes=manifest.notes,
    )


def _write(site: Site, folder: Path, final: Path) -> None:
    floors = [
        FloorEntry(
            name=floor.name,
            level=floor.level,
            width_m=floor.width_m,
            height_m=floor.height_m,
            file=f"floors/{_file_name(floor.name)}.geojson",
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
    save_tracks(folder / _TRACKS, site.survey_tracks)
    manifest = Manifest(
        format=FORMAT,
        tickfix=tickfix.__version__,
        name=site.name,
        floors=floors,
        held_out=[_held_out_entry(held_out, final) for held_out in site.held_out],
        models=models,
        notes=dict(site.notes),
    )
    save_manifest(folder, manifest)


def _file_name(name: str) -> str:
    return quote(name, safe=" ") or "%"


def _held_out_entry(held_out: HeldOut, site: Path) -> HeldOutEntry:
    path = held_out.path
    return HeldOutEntry(
        walk=held_out.walk,
        floor=held_out.floor,
        chain=held_out.chain,
        path=None if path is None else path.as_posix(),
        relative_path=None if path is None else Path(os.path.relpath(path, site)).as_posix(),
        sha256=held_out.sha256,
    )


def _held_out(entry: HeldOutEntry, site: Path) -> HeldOut:
    candidates = [Path(os.path.normpath(site / entry.relative_path))] if entry.relative_path is not None else []
    candidates += [Path(entry.path)] if entry.path is not None else []
    there = [path for path in candidates if path.is_file()] or candidates[-1:]
    return HeldOut(
        walk=entry.walk,
        floor=entry.floor,
        chain=entry.chain,
        path=there[0] if there else None,
        sha256=entry.sha256,
    )
