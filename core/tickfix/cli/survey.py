"""``tickfix survey``: recordings become a site."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Final

import typer
from rich import box
from rich.table import Table

from tickfix.api import SiteError
from tickfix.cli.console import progress, registry, stdout, warn_each
from tickfix.config import load_config
from tickfix.replay.recording_files import find_recordings
from tickfix.replay.site_survey import survey_files
from tickfix.site import Site, is_site, save_site

_REJECTED: Final = "rejected: "

ConfigFile = Annotated[
    Path | None, typer.Option("--config", metavar="FILE", help="TOML file of pipelines; tickfix's own without one.")
]
Seed = Annotated[int | None, typer.Option("--seed", min=0, metavar="N", help="Of all random streams.")]


def survey(
    recordings: Annotated[list[Path], typer.Argument(metavar="RECORDINGS…", help="Files, or folders of them.")],
    *,
    out: Annotated[Path, typer.Option("--out", metavar="SITE", help="Folder to make; a site there is replaced.")],
    holdout: Annotated[
        float, typer.Option("--holdout", min=0.0, max=1.0, metavar="SHARE", help="Share of walks kept for testing.")
    ] = 0.0,
    config: ConfigFile = None,
    seed: Seed = None,
) -> None:
    """Survey recordings with waypoints: floor plans, radio map, trained models, and walks held out for testing."""
    began = time.perf_counter()
    plugins = registry()
    settings = load_config(config, plugins)
    if out.exists() and not is_site(out) and not (out.is_dir() and not any(out.iterdir())):
        raise SiteError(f"{out}: found something that is no tickfix site; it is left alone, choose another --out")
    files = find_recordings(recordings, plugins)
    with progress() as show:
        surveyed = survey_files(
            files.sources,
            settings.pipelines,
            name=out.absolute().name,
            holdout=holdout,
            seed=settings.kernel.seed if seed is None else seed,
            progress=show,
        )
    save_site(surveyed.site, out)
    warn_each((*files.problems, *surveyed.problems), "problems")
    _print_survey(surveyed.site, out, len(files.sources), time.perf_counter() - began)


def _print_survey(site: Site, out: Path, files: int, seconds: float) -> None:
    floors = ", ".join(f"{f.name} ({f.width_m:.0f} × {f.height_m:.0f} m)" if f.width_m else f.name for f in site.floors)
    rows = {
        "floors": floors,
        "recordings": str(files),
        "walks surveyed": str(site.notes.get("walks", 0)),
        "walks held out": str(len(site.held_out)),
        "reference points": str(len(site.radio_map)),
        "transmitters": str(len(site.radio_map.transmitters)),
        "samples": str(len(site.radio_map.sample_rssi_dbm)),
        "models": ", ".join(site.models) or "none",
        "lines rejected": str(sum(n for note, n in site.notes.items() if note.startswith(_REJECTED))),
    }
    for note, count in site.notes.items():
        if note.startswith(_REJECTED):
            rows[f"  {note.removeprefix(_REJECTED)}"] = str(count)
    rows["seconds"] = f"{seconds:.1f}"
    table = Table(box=box.SIMPLE, show_header=False, padding=(0, 1))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for row in rows.items():
        table.add_row(*row)
    console = stdout()
    console.print(f"Surveyed {site.name} into {out}", soft_wrap=True)
    console.print(table)
    if site.held_out:
        console.print(f"Next: tickfix replay {out} --holdout", soft_wrap=True)
