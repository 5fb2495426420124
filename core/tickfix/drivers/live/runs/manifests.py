"""What a journal's manifest says of a live run, to whoever goes on from it or repeats it."""

from __future__ import annotations

import time
from importlib.metadata import version
from pathlib import Path

import tickfix
from tickfix.config import Config, parse
from tickfix.drivers.live.errors import EngineError
from tickfix.drivers.live.order import Order
from tickfix.journal import JournalReader, Manifest
from tickfix.kernel.probe import numeric_probe
from tickfix.plugins import Registry


def manifest_for(order: Order, registry: Registry, run: str, before: Manifest | None) -> Manifest:
    """Return the manifest of a run that begins, or goes on from where ``before`` was written."""
    libraries = {name: version(name) for name in ("numpy", "scipy", "shapely", "pyzmq", "msgspec", "mcap")}
    return Manifest(
        run=run,
        tickfix_version=tickfix.__version__,
        config=order.config.text,
        seed=order.config.kernel.seed,
        probe=numeric_probe(),
        wall_start_ns=time.time_ns() if before is None else before.wall_start_ns,
        plugins=libraries | {offer.distribution: offer.version for offer in registry.offers if offer.distribution},
        notes={
            "site": str(order.site.resolve()),
            "boot": str(1 if before is None else boot_of(before) + 1),
            "pipelines": ",".join(p.name for p in order.config.pipelines),
            "disabled": "\n".join(f"{key}\t{why}" for key, why in sorted(order.disabled.items())),
        },
    )


def manifest_of(folder: Path) -> Manifest:
    """Return the manifest of a journal's newest segment that has one.

    Raises:
        JournalError: when there is no journal.
        EngineError: when no segment has an intact manifest.
    """
    manifests = [segment.manifest for segment in JournalReader(folder).segments() if segment.manifest is not None]
    if not manifests:
        raise EngineError(f"{folder}: no segment has an intact manifest, so nothing can be resumed")
    return manifests[-1]


def boot_of(manifest: Manifest) -> int:
    """Return which engine of its run wrote this, from 1."""
    return int(manifest.notes.get("boot", "1"))


def site_of(manifest: Manifest) -> Path:
    """Return the folder of the site that the run served."""
    return Path(manifest.notes["site"])


def config_of(manifest: Manifest, registry: Registry) -> Config:
    """Return the run's configuration, with the pipelines that were chosen of it.

    Raises:
        ConfigError: when it cannot be used here.
    """
    config = parse(manifest.config, "the journal's configuration", registry)
    return config.only(manifest.notes["pipelines"].split(","))


def disabled_in(manifest: Manifest) -> frozenset[str]:
    """Return the keys of the stages that had to be left out."""
    lines = manifest.notes.get("disabled", "").split("\n")
    return frozenset(line.split("\t")[0] for line in lines if line)
