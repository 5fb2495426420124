"""The tables of [wang2015] beside ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from tickfix.api import Floats
from tickfix.reproduction.intervals import row
from tickfix.reproduction.report import Table
from tickfix.reproduction.wang2015.gross import EPOCHS_S, ON_ODOMETRY, ON_WIFI
from tickfix.reproduction.wang2015.run import Walked
from tickfix.reproduction.wang2015.schemes import (
    BY_EKF,
    DISTURBED,
    GCK,
    MAPPED_PARTICLES,
    MWPO,
    PARTICLES,
    PDR,
    UNMAPPED_PARTICLES,
    WPO,
    sized,
)
from tickfix.reproduction.wang2015.walks import FIX_S

TABLE_1_M2: Final = dict(zip(UNMAPPED_PARTICLES, (4.34, 3.58, 3.25, 3.09, 3.12), strict=True))
TABLE_2_M2: Final = dict(zip(MAPPED_PARTICLES, (2.890, 2.599, 2.601, 2.615, 2.640), strict=True))
TABLE_4_M: Final = {
    GCK: (4.037, 3.135, 10.375),
    PDR: (5.993, 4.990, 12.650),
    WPO: (2.618, 2.344, 4.708),
    MWPO: (2.491, 1.922, 4.664),
}
TABLE_6_M: Final = {WPO: (4.8224, 3.5404, 3.0557), MWPO: (1.8483, 1.4832, 0.6947)}
TABLE_8_M: Final = {WPO: (9.6667, 8.5872, 6.3026), MWPO: (1.1344, 2.0504, 1.3445)}


def mse_m2(walks: Sequence[Walked], scheme: str) -> Floats:
    """Return the mean of the squared errors of each walk, (seeds,) m²."""
    return np.array([np.mean(walk.error_m(scheme) ** 2) for walk in walks])


def rmse_m(walks: Sequence[Walked], scheme: str) -> Floats:
    """Return its root, (seeds,) metres."""
    root: Floats = np.sqrt(mse_m2(walks, scheme))
    return root


def residuals_m(walks: Sequence[Walked], scheme: str, after_s: float = 0.0) -> Floats:
    """Return the residuals at, or ``after_s`` after, the epochs of the gross errors, (seeds, 3) metres."""
    return np.array([[walk.residual_m(scheme, t_s + after_s) for t_s in EPOCHS_S] for walk in walks])


def tables(walks: Sequence[Walked]) -> tuple[Table, ...]:
    """Return Tables 1, 2, 4, 6 and 8; the others say what was put in."""
    return (
        _sizes(walks, "Table 1", TABLE_1_M2, mapped=False),
        _sizes(walks, "Table 2", TABLE_2_M2, mapped=True),
        _schemes(walks),
        _residuals(walks, "Table 6", "10 m on Wi-Fi positions", TABLE_6_M, ON_WIFI),
        _residuals(walks, "Table 8", "10 m on P-O increments", TABLE_8_M, ON_ODOMETRY),
        _residuals(walks, "Tables 6 and 8, undisturbed", "without any", {}, ""),
    )


def _sizes(walks: Sequence[Walked], name: str, printed: Mapping[int, float], *, mapped: bool) -> Table:
    rows = {
        str(particles): row([mse_m2(walks, sized(particles, mapped=mapped))], [printed.get(particles)])
        for particles in PARTICLES
    }
    return Table(
        name=name,
        caption=f"mean square error by number of particles, {'with' if mapped else 'without'} the floor map",
        columns=("MSE, m²",),
        rows=rows,
        note="Sizes without a figure of the paper are in its other table. Calculation times are not compared.",
    )


def _schemes(walks: Sequence[Walked]) -> Table:
    rows = {}
    for scheme in (*TABLE_4_M, BY_EKF):
        errors = [walk.error_m(scheme) for walk in walks]
        ours = (rmse_m(walks, scheme), *(np.array([of(e) for e in errors]) for of in (np.mean, np.max)))
        printed: tuple[float | None, ...] = TABLE_4_M.get(scheme, (None, None, None))
        rows[scheme] = row(ours, printed)
    return Table(
        name="Table 4",
        caption="errors of the four schemes",
        columns=("RMSE, m", "AE, m", "ME, m"),
        rows=rows,
        note="The paper calls the first column MSE, in metres. “EKF's walk”: particles walk by the EKF's velocity.",
    )


def _residuals(
    walks: Sequence[Walked], name: str, what: str, printed: Mapping[str, tuple[float, ...]], suffix: str
) -> Table:
    rows = {}
    for scheme in DISTURBED:
        paper: tuple[float | None, ...] = printed.get(scheme, (None,) * len(EPOCHS_S))
        at, later = (residuals_m(walks, scheme + suffix, after_s) for after_s in (0.0, FIX_S))
        rows[scheme] = row([*at.T, later.mean(axis=1)], [*paper, None])
    return Table(
        name=name,
        caption=f"residuals at the epochs of gross errors, {what}",
        columns=(*(f"{t_s:g} s, m" for t_s in EPOCHS_S), f"{FIX_S:g} s later, m"),
        rows=rows,
        note="The last column is the mean over the three epochs that follow. What fails the test of eq. (22) counts, "
        "with λ = 1, as printed; “dropping” leaves it out, as the text has it. “EKF's walk”: particles walk by the "
        "EKF's velocity.",
    )
