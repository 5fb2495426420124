"""The figures of [jiang2015] drawn again: Figs. 14, 15 and 16, and the error by quality of Wi-Fi."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.artist import Artist

from tickfix.api import Floats
from tickfix.evaluation.pictures import draw_cdf, draw_plan
from tickfix.evaluation.theme import FOREGROUND, canvas, legend, line_styles
from tickfix_papers.jiang2015.claims import METHODS, WIFI
from tickfix_papers.jiang2015.seed_run import SeedRun
from tickfix_papers.jiang2015.twin import floor_plan

_SECONDS: Final = np.arange(2.0, 40.0, 0.2)
_PANELS: Final = ("ELM", "ELM + KF", "ELM + PF", "ELM + Wi-Fi + PF")


def draw(runs: Sequence[SeedRun], folder: Path) -> tuple[Path, ...]:
    """Draw all figures as PNG and return their paths."""
    cdf, tracks_path, growth, given = (
        folder / f"jiang2015-{name}.png" for name in ("fig14-wifi", "fig15-ways", "fig16-growth", "given-wifi")
    )
    errors = {
        label: np.concatenate([track.fix_error_m for run in runs for track in run.tracks[pipeline]])
        for label, pipeline in WIFI.items()
    }
    draw_cdf(errors, cdf, title=f"Wi-Fi alone, {len(runs)} seeds (Fig. 14)")
    _draw_tracks(runs[0], tracks_path)
    _draw_error_growth(runs, growth)
    _draw_given(runs, given)
    return cdf, tracks_path, growth, given


def _draw_tracks(run: SeedRun, path: Path) -> None:
    """Draw the first walk of a seed by four methods: as printed, and with own settings."""
    with canvas(path, (7.2, 4.4)) as figure:
        panels = figure.subplots(2, 4, sharex=True, sharey=True)
        for row, (column, title) in enumerate(((0, "as printed"), (1, "own settings"))):
            for axes, label in zip(panels[row], _PANELS, strict=True):
                draw_plan(axes, floor_plan())
                (true,) = axes.plot(*run.truth[0].T, color=FOREGROUND, linewidth=0.8, dashes=(5, 3))
                (style,) = line_styles(1)
                (track_line,) = axes.plot(
                    *run.tracks[str(METHODS[label][column])][0].xy.T, color=style.color, linewidth=1.0
                )
                axes.set(aspect="equal", xlim=(-2.0, 16.0), ylim=(-2.0, 17.0))
                axes.set_title(f"{label}\n{title}", fontsize=7.5)
        legend(figure, [(true, "truth"), (track_line, "told")], beside=False)


def _draw_error_growth(runs: Sequence[SeedRun], path: Path) -> None:
    """Draw the mean error of all walks by the time walked."""
    with canvas(path, (7.2, 3.4)) as figure:
        panels = figure.subplots(1, 2, sharey=True)
        entries: list[tuple[Artist, str]] = []
        for column, (axes, title) in enumerate(zip(panels, ("as printed", "own settings"), strict=True)):
            entries = []
            for style, label in zip(line_styles(len(_PANELS)), _PANELS, strict=True):
                error_m = _by_time(runs, str(METHODS[label][column]))
                (line,) = axes.plot(_SECONDS, error_m, color=style.color, linestyle=style.dashes, linewidth=style.width)
                entries.append((line, label))
            axes.set(xlabel="time, s", xlim=(0.0, _SECONDS[-1]))
            axes.set_ylim(bottom=0.0)
            axes.set_title(f"{title} (Fig. 16)")
        panels[0].set_ylabel("mean error, m")
        legend(figure, entries, beside=False)


def _by_time(runs: Sequence[SeedRun], pipeline: str) -> Floats:
    tracks = [track for run in runs for track in run.tracks[pipeline]]
    each: Floats = np.array([np.interp(_SECONDS, track.t_s, track.error_m) for track in tracks])
    mean: Floats = each.mean(axis=0)
    return mean


def _draw_given(runs: Sequence[SeedRun], path: Path) -> None:
    """Draw the fused filter's error by that of the location results it is given."""
    with canvas(path, (4.2, 3.4)) as figure:
        axes = figure.add_subplot()
        entries = []
        sigmas = sorted(runs[0].given)
        off = np.array(sigmas) * np.sqrt(np.pi / 2.0)
        for style, (pipeline, label, alone) in zip(
            line_styles(2),
            (("elm-wifi-pf", "as printed", "elm"), ("own-elm-wifi-pf", "own settings", "own-elm")),
            strict=True,
        ):
            fused = [np.mean([run.given[sigma][pipeline] for run in runs]) for sigma in sigmas]
            (line,) = axes.plot(off, fused, color=style.color, linestyle=style.dashes, linewidth=1.5)
            level = axes.axhline(
                float(np.mean([run.mean_error_m(alone) for run in runs])), color=style.color, linewidth=0.6
            )
            entries += [(line, f"fused, {label}"), (level, f"ELM alone, {label}")]
        axes.set(xlabel="mean error of the location results, m", ylabel="mean error, m", xlim=(0.0, off[-1]))
        axes.set_ylim(bottom=0.0)
        axes.set_title("How good Wi-Fi must be")
        legend(figure, entries, beside=False)
