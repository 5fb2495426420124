"""The figures of [sun2013] drawn again: error surfaces (4), one walk (5 to 7), distributions of the errors (8)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from tickfix.api import Floats
from tickfix.evaluation.pictures import draw_cdf, draw_plan
from tickfix.evaluation.theme import FOREGROUND, MUTED, canvas, legend, line_styles
from tickfix_papers.sun2013 import twin
from tickfix_papers.sun2013.seed_run import SeedRun
from tickfix_papers.sun2013.systems import FNCC, KMF, KNN, MAP, WKNN

_CDF: Final = (KNN, WKNN, FNCC, FNCC + MAP, KNN + KMF, FNCC + KMF)


def draw(runs: Sequence[SeedRun], folder: Path) -> tuple[Path, ...]:
    """Draw into a folder that exists; return the files."""
    surfaces, walk, cdf = (folder / f"sun2013-{name}.png" for name in ("surfaces", "walk", "cdf"))
    _draw_surfaces(runs, surfaces)
    _draw_walk(runs[0], walk)
    errors = {name: np.concatenate([run.error_m[name].ravel() for run in runs]) for name in _CDF}
    draw_cdf(errors, cdf, title=f"Figure 8: all passes of {len(runs)} seeds")
    return surfaces, walk, cdf


def _draw_surfaces(runs: Sequence[SeedRun], path: Path) -> None:
    surfaces = {name: np.mean([run.surface_m[name] for run in runs], axis=0) for name in (FNCC, KNN)}
    low, high = (float(f([f(s) for s in surfaces.values()])) for f in (np.min, np.max))
    with canvas(path, (7.6, 3.4)) as figure:
        panels: Any = figure.subplots(1, 2, sharey=True)
        for axes, (name, surface) in zip(panels, surfaces.items(), strict=True):
            image = axes.imshow(surface, origin="lower", cmap="viridis", vmin=low, vmax=high)
            axes.set_xticks(range(len(twin.SURFACE_K)), [str(k) for k in twin.SURFACE_K])
            axes.set_yticks(range(len(twin.SURFACE_N)), [str(n) for n in twin.SURFACE_N])
            axes.set(title=f"Figure 4: mean error of {name}, m", xlabel="K")
            for (row, column), error_m in np.ndenumerate(surface):
                color = "white" if error_m < (low + high) / 2 else FOREGROUND
                axes.text(column, row, f"{error_m:.2f}", ha="center", va="center", fontsize=6, color=color)
        panels[0].set_ylabel("N")
        figure.colorbar(image, ax=panels, label="m")


def _draw_walk(run: SeedRun, path: Path) -> None:
    """Draw the first pass of the first seed, KNN and FNCC beside each other, alone and with the KMF."""
    truth = twin.test_points()[0]
    with canvas(path, (7.6, 5.2)) as figure:
        entries = []
        panels: Any = figure.subplots(1, 2, sharey=True)
        for axes, name in zip(panels, (FNCC, KNN), strict=True):
            draw_plan(axes, twin.floor_plan())
            for line in twin.WALKWAYS:
                axes.plot(*np.array(line).T, color=MUTED, linewidth=0.5)
            (truth_line,) = axes.plot(*truth.T, color=FOREGROUND, linewidth=0.8, marker="o", markersize=2.0)
            entries = [(truth_line, "test points")]
            for style, filter_name in zip(line_styles(2), ("", KMF), strict=True):
                positions: Floats = run.first_pass[name + filter_name]
                (track,) = axes.plot(*positions.T, color=style.color, linestyle=style.dashes, linewidth=1.0)
                entries.append((track, f"fingerprint{filter_name}"))
            axes.set(xlim=(0.0, twin.WIDTH_M), ylim=(0.0, 30.0), aspect="equal", xlabel="x, m")
            axes.set_title(f"Figures 5 to 7: {name} and {name}{KMF}")
        panels[0].set_ylabel("y, m")
        legend(figure, entries, beside=False)
