"""The tables of [jiang2015], and what its Figs. 14 and 17 show, with the paper's figures beside ours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from tickfix.reproduction.intervals import mean, row
from tickfix.reproduction.jiang2015.measure import GIVEN_SIGMA_M, Measured
from tickfix.reproduction.report import Cell, Table

WINDOWS: Final = {
    200: (0.3001, 25.0529),
    400: (0.4020, 27.8570),
    600: (0.4158, 26.8727),
    800: (0.4642, 26.5759),
    1000: (0.4435, 26.4503),
}
"""[jiang2015] Table 3: velocity and orientation."""
METHODS: Final = {
    "gait + PF": ("gait-pf", "", 1.542),
    "ELM": ("elm", "own-elm", 0.609),
    "ELM, heading as sine and cosine": ("vector-elm", "", None),
    "ELM + KF": ("elm-kf", "own-elm-kf", 0.829),
    "ELM + PF": ("elm-pf", "own-elm-pf", 0.633),
    "ELM + Wi-Fi + PF": ("elm-wifi-pf", "own-elm-wifi-pf", 0.150),
    "ELM + Wi-Fi + own PF": ("", "own-fusion", None),
}
"""[jiang2015] Table 4: pipeline as printed, with tickfix's own settings, and the paper's mean error in metres."""
WIFI: Final = {"KNN": "wifi-knn", "ELM": "wifi-elm", "ELM + KF": "wifi-elm-kf", "ELM + PF": "wifi-elm-pf"}
RATES: Final = {"Wi-Fi alone": ("wifi-elm", 4.5), "ELM + Wi-Fi + PF": ("elm-wifi-pf", 0.2)}


def tables(runs: Sequence[Measured]) -> tuple[Table, ...]:
    """Return all tables."""
    return _windows(runs), _methods(runs), _wifi(runs), _rates(runs), _given(runs)


def velocity_rms(run: Measured, window_ms: int) -> float:
    """Return the root of the velocity's mean square error, m/s."""
    return float(np.sqrt(run.window_mse[window_ms][0]))


def heading_rms(run: Measured, window_ms: int) -> float:
    """Return the root of the orientation's mean square error, degrees."""
    return float(np.degrees(np.sqrt(run.window_mse[window_ms][1])))


def _windows(runs: Sequence[Measured]) -> Table:
    return Table(
        name="Table 3",
        caption="errors of velocity and orientation by window length, ten-fold cross-validation",
        columns=("velocity, m/s", "orientation, °"),
        rows={
            f"{window_ms} ms": row(
                [[rms(run, window_ms) for run in runs] for rms in (velocity_rms, heading_rms)], paper
            )
            for window_ms, paper in WINDOWS.items()
        },
        decimals=(3, 1),
        note="The paper calls its figures mean square errors in degrees; ours are the roots, to which its units fit.",
    )


def _methods(runs: Sequence[Measured]) -> Table:
    def ours(pipeline: str, paper: float | None = None) -> Cell:
        return Cell(paper=paper, ours=mean([run.mean_error_m(pipeline) for run in runs]) if pipeline else None)

    return Table(
        name="Table 4",
        caption="mean error of methods that use motion, m",
        columns=("as printed", "own settings"),
        rows={label: (ours(printed, paper), ours(own)) for label, (printed, own, paper) in METHODS.items()},
        note="Own settings: tickfix's defaults of the regression. They take the heading as sine and cosine, choose the "
        "hidden nodes by folds that keep walks together, regularise more, and let a phone at rest stay. Rows without a "
        "figure of the paper were added after a first look.",
    )


def _wifi(runs: Sequence[Measured]) -> Table:
    rows = {}
    for label, pipeline in WIFI.items():
        median = [float(np.median(np.concatenate([t.located_m for t in run.tracks[pipeline]]))) for run in runs]
        rows[label] = row([[run.mean_located_m(pipeline) for run in runs], median])
    return Table(
        name="Fig. 14",
        caption="error of location results of Wi-Fi alone, m",
        columns=("mean", "median"),
        rows=rows,
        note="The figure is drawn in the paper, without numbers.",
    )


def _rates(runs: Sequence[Measured]) -> Table:
    return Table(
        name="Fig. 17",
        caption="time from one position to the next, s",
        columns=("mean",),
        rows={
            label: row([[every_s(run, pipeline) for run in runs]], [paper])
            for label, (pipeline, paper) in RATES.items()
        },
        note="The twin scans about every 2 s, as sections 2 and 7 print; Fig. 17 shows 4.5 s.",
    )


def every_s(run: Measured, pipeline: str) -> float:
    """Return the mean time from one published position to the next, seconds."""
    return float(np.mean([track.every_s for track in run.tracks[pipeline]]))


def _given(runs: Sequence[Measured]) -> Table:
    return Table(
        name="How good Wi-Fi must be",
        caption="mean error of ELM + Wi-Fi + PF, m, with location results of a given error in the place of Wi-Fi's",
        columns=("as printed", "own settings"),
        rows={
            f"σ {sigma_m:g} m, off by {sigma_m * np.sqrt(np.pi / 2.0):.2f} m": row(
                [[run.given[sigma_m][pipeline] for run in runs] for pipeline in ("elm-wifi-pf", "own-elm-wifi-pf")]
            )
            for sigma_m in GIVEN_SIGMA_M
        },
        note="Not in the paper, and added after a first look: fixes are drawn around the true place of their scan.",
    )
