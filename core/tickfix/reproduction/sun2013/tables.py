"""The tables of [sun2013], the paper's figures beside ours."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from tickfix.api import Floats
from tickfix.reproduction.intervals import exact, mean, row
from tickfix.reproduction.report import Cell, Table
from tickfix.reproduction.sun2013 import choices, pipelines, printed
from tickfix.reproduction.sun2013.causes import FILTERED, LOUDER_DB
from tickfix.reproduction.sun2013.complexity import operation_counts
from tickfix.reproduction.sun2013.pipelines import FINGERPRINTS, FNCC, KF, KMF, KNN, MAP
from tickfix.reproduction.sun2013.repetition import Repetition


def tables(runs: Sequence[Repetition]) -> tuple[Table, ...]:
    """Return Tables 2 to 5, the reductions they imply, figure 4 in part, and the readings of eq. (1)."""
    return (
        _errors(runs, "Table 2", "fingerprints alone, N = 2, K = 7", FINGERPRINTS, _TABLE_2),
        _operations(),
        _errors(runs, "Table 4", "after map matching", [name + MAP for name in FINGERPRINTS]),
        _errors(
            runs,
            "Table 5",
            "Kalman filter and Kalman/map filter; alone and + Map as above",
            [name + aid for aid in (KF, KMF) for name in FINGERPRINTS],
        ),
        _reductions(runs),
        _surface(runs),
        _variants(runs),
        *_causes(runs),
    )


def figures(error_m: Floats) -> tuple[float, float, float, float]:
    """Return mean and standard deviation in metres, and the shares in per cent within 2 m and 3 m."""
    within = [100.0 * float(np.mean(error_m <= limit)) for limit in (2.0, 3.0)]
    return float(error_m.mean()), float(error_m.std()), within[0], within[1]


def reductions(runs: Sequence[Repetition], fingerprint: str, aid: str) -> Floats:
    """Return by how many per cent an aid reduces a fingerprint's mean error: one value a seed."""
    before, after = (np.array([run.error_m[name].mean() for run in runs]) for name in (fingerprint, fingerprint + aid))
    percent: Floats = 100.0 * (before - after) / before
    return percent


_TABLE_2 = (
    "The rows NCC (1), FNCC (5) and FNCC (6) are one here: eqs. (5) and (6) are the same quantity, and with its "
    "sign kept it chooses the K points of eq. (1), see the table of eqs. (1)–(6)."
)


def _errors(runs: Sequence[Repetition], name: str, caption: str, systems: Iterable[str], note: str = "") -> Table:
    rows = {}
    for system in systems:
        ours = np.array([figures(run.error_m[system]) for run in runs]).T
        rows[system] = row(list(ours), printed.ERRORS[system])
    return Table(name=name, caption=caption, columns=printed.COLUMNS, rows=rows, decimals=(2, 2, 1, 1), note=note)


def _operations() -> Table:
    counts = operation_counts(L=91, M=9, N=choices.ONLINE_SAMPLES, K=choices.POINTS_AVERAGED)
    rows = {}
    for name, paper in printed.OPERATIONS.items():
        ours = (counts[name].additions, counts[name].multiplications, counts[name].square_roots)
        rows[name] = tuple(Cell(paper=p, ours=exact(o)) for p, o in zip(paper, ours, strict=True))
    columns = ("additions", "multiplications", "square roots")
    caption = "operations of one result by the paper's formulas, L = 91, M = 9, N = 2, K = 7"
    return Table(name="Table 3", caption=caption, columns=columns, rows=rows, decimals=0)


def _reductions(runs: Sequence[Repetition]) -> Table:
    rows = {}
    for fingerprint in FINGERPRINTS:
        rows[fingerprint] = row(
            [reductions(runs, fingerprint, aid) for aid in (MAP, KF, KMF)],
            [printed.reduction_percent(fingerprint + aid, fingerprint) for aid in (MAP, KF, KMF)],
        )
    return Table(
        name="Tables 2, 4, 5",
        caption="reduction of the mean error",
        columns=("map alone, %", "KF alone, %", "KMF, %"),
        rows=rows,
        decimals=1,
    )


def _surface(runs: Sequence[Repetition]) -> Table:
    """Return two sections through figure 4: over K at N = 2, over N at K = 7."""
    n2, k7 = choices.SURFACE_N.index(choices.ONLINE_SAMPLES), choices.SURFACE_K.index(choices.POINTS_AVERAGED)
    sections = [(f"N = 2, K = {k}", (n2, i)) for i, k in enumerate(choices.SURFACE_K)]
    sections += [(f"N = {n}, K = 7", (i, k7)) for i, n in enumerate(choices.SURFACE_N) if i != n2]
    rows = {label: row([[run.surface_m[name][at] for run in runs] for name in (KNN, FNCC)]) for label, at in sections}
    return Table(
        name="Figure 4", caption="mean error over N and K, two sections", columns=("KNN, m", "FNCC, m"), rows=rows
    )


def _variants(runs: Sequence[Repetition]) -> Table:
    rows: Mapping[str, tuple[Cell, ...]] = {
        name: (
            Cell(paper=None, ours=mean([run.variant_error_m[name].mean() for run in runs])),
            Cell(
                paper=None, ours=mean([run.same_points[name] for run in runs]) if name in runs[0].same_points else None
            ),
        )
        for name in runs[0].variant_error_m
    }
    return Table(
        name="Eqs. (1)–(6)",
        caption=f"readings of the correlation, on {choices.COMPARED_PASSES} passes",
        columns=("mean, m", "same K points as (1), %"),
        rows=rows,
        decimals=(2, 1),
        note=f"{pipelines.FNCC} alone is the one of Table 2: signed, the best of a point's blocks of N survey samples. "
        "“means” has the mean of a point's samples in every column of RSS_l.",
    )


def _causes(runs: Sequence[Repetition]) -> tuple[Table, Table]:
    found = [run.causes for run in runs]
    rows = {
        "every usual access point heard": [c.whole_m for c in found],
        "one of them missing": [c.gap_m for c in found],
        f"if the laptop read {LOUDER_DB:.0f} dB more": [c.louder_m for c in found],
        "correlation of neighbouring errors": [c.correlation for c in found],
    }
    gaps = mean([c.gaps for c in found]).text(0, "%")
    fingerprints = Table(
        name="Causes 1",
        caption="mean error of the fingerprints, m, and how alike neighbouring errors are",
        columns=FINGERPRINTS,
        rows={label: row([[one[name] for one in values] for name in FINGERPRINTS]) for label, values in rows.items()},
        note=f"{gaps} of queries lack an access point that the test point hears in half of its samples or more. Both "
        "tables of causes were added after the first results and decide no claim.",
    )
    filters = Table(
        name="Causes 2",
        caption=f"mean error of the filters, on {choices.COMPARED_PASSES} passes",
        columns=("fed with the true points, m", "fed with FNCC, m"),
        rows={name: row([[c.lag_m[name] for c in found], [c.filtered_m[name] for c in found]]) for name in FILTERED},
        note="The paper prints 0.05 m/s² for σ of the acceleration; the plugin's own default is 0.5 m/s².",
    )
    return fingerprints, filters
