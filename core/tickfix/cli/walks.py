"""Which walks a command runs on a site, and what to warn of before."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tickfix.api import ConfigError, SiteError
from tickfix.cli.output import warn, warn_of
from tickfix.config import Config
from tickfix.drivers.recordings import Source, find
from tickfix.evaluation.run import untrained
from tickfix.plugins import Registry
from tickfix.site.site import Site


def chosen_walks(
    command: str, site: Site, walks: Sequence[Path], found: Registry, *, holdout: bool
) -> tuple[Source, ...]:
    """Return the walks given, or those that the survey held out.

    Raises:
        ConfigError: for both or neither, and for walks that share a name.
        SiteError: when no walk was held out, or one is gone.
    """
    if holdout and walks:
        raise ConfigError(command, "both WALKs and --holdout", "one of the two")
    if not holdout and not walks:
        raise ConfigError(command, "no walks", "recordings after SITE, or --holdout")
    if holdout and not site.held_out:
        raise SiteError(f"site {site.name!r}: no walk was held out; survey again with --holdout 0.3")
    files = find([held.file() for held in site.held_out] if holdout else walks, found)
    warn_of(files.problems, "problems of readers")
    names = [_stem(source.path) for source in files.sources]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ConfigError(command, f"several walks called {twice[0]!r}", "walks with different names")
    learnt = {track.walk for track in site.survey_tracks}
    if known := [name for name in names if name in learnt]:
        warn(
            f"{known[0]}{' and others' if len(known) > 1 else ''}: part of the survey, which flatters the errors: "
            "the site has learnt from it"
        )
    return files.sources


def warn_untrained(site: Site, settings: Config, config: Path | None) -> None:
    """Warn of algorithms that learn, but for whose parameters the site has no model."""
    for label in untrained(site, settings):
        again = "tickfix survey" if config is None else f"tickfix survey --config {config}"
        warn(f"{label}: the site has no model for these parameters; it runs untrained. Survey again: {again} …")


def _stem(path: Path) -> str:
    return path.name.removesuffix(".gz").rpartition(".")[0] or path.name
