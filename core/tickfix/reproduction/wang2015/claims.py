"""What [wang2015] claims, decided by paired differences over seeds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from tickfix.api import Floats
from tickfix.reproduction.intervals import difference, judge, mean
from tickfix.reproduction.report import Claim
from tickfix.reproduction.wang2015.gross import ON_ODOMETRY, ON_WIFI
from tickfix.reproduction.wang2015.run import Walked
from tickfix.reproduction.wang2015.schemes import (
    BY_EKF,
    DROPPED,
    GCK,
    MAPPED_PARTICLES,
    MWPO,
    PDR,
    UNMAPPED_PARTICLES,
    WPO,
    sized,
)
from tickfix.reproduction.wang2015.tables import (
    TABLE_1_M2,
    TABLE_2_M2,
    TABLE_4_M,
    TABLE_6_M,
    TABLE_8_M,
    mse_m2,
    residuals_m,
    rmse_m,
)

_BARELY_M: Final = 1.0
"""Of an error of 10 m put in, less than a tenth may arrive where the effects are said to be mitigated."""


def claims(walks: Sequence[Walked]) -> tuple[Claim, ...]:
    """Return every claim with the figures that decide it."""
    return (*_orders(walks), *_particles(walks), *_gross(walks))


def _orders(walks: Sequence[Walked]) -> list[Claim]:
    rmse = {scheme: rmse_m(walks, scheme) for scheme in TABLE_4_M}

    def better(claim: str, worse: str, than: str) -> Claim:
        return judge(
            claim,
            difference(rmse[worse], rmse[than]),
            paper=f"RMSE {TABLE_4_M[worse][0]:.2f} → {TABLE_4_M[than][0]:.2f} m",
            ours=f"{mean(rmse[worse]).text()} → {mean(rmse[than]).text()} m",
            above=0.0,
        )

    reckoned = [walk.error_m(PDR) for walk in walks]
    growth = np.array([e[2 * len(e) // 3 :].mean() - e[: len(e) // 3].mean() for e in reckoned])
    return [
        better("PDR alone is worse than Wi-Fi alone (GCK), and so worst of all", PDR, GCK),
        judge(
            "the error of PDR accumulates",
            mean(growth),
            paper="grows to more than 12 m within 120 s (Figure 16)",
            ours=f"the last third of the walk is worse than the first by {mean(growth).text()} m",
            above=0.0,
        ),
        better("WPO is better than Wi-Fi alone (GCK)", GCK, WPO),
        better("MWPO is better than WPO", WPO, MWPO),
    ]


def _particles(walks: Sequence[Walked]) -> list[Claim]:
    few = np.mean([mse_m2(walks, sized(n, mapped=True)) for n in MAPPED_PARTICLES], axis=0)
    many = np.mean([mse_m2(walks, sized(n, mapped=False)) for n in UNMAPPED_PARTICLES], axis=0)
    fewest, enough = (mse_m2(walks, sized(n, mapped=False)) for n in (UNMAPPED_PARTICLES[0], 300))
    return [
        judge(
            "40 to 80 particles with the map do better than 100 to 500 without",
            difference(many, few),
            paper=f"mean MSE {np.mean(list(TABLE_1_M2.values())):.2f} → {np.mean(list(TABLE_2_M2.values())):.2f} m²",
            ours=f"{mean(many).text()} → {mean(few).text()} m²",
            above=0.0,
        ),
        judge(
            "without the map 300 particles do better than 100",
            difference(fewest, enough),
            paper=f"MSE {TABLE_1_M2[100]:.2f} → {TABLE_1_M2[300]:.2f} m²",
            ours=f"{mean(fewest).text()} → {mean(enough).text()} m²",
            above=0.0,
        ),
    ]


def _gross(walks: Sequence[Walked]) -> list[Claim]:
    found: list[Claim] = []
    for where, suffix, printed in (("on Wi-Fi", ON_WIFI, TABLE_6_M), ("on P-O", ON_ODOMETRY, TABLE_8_M)):
        hurt, spared = _arrived(walks, WPO, suffix), _arrived(walks, MWPO, suffix)
        theirs = {scheme: f"residuals of {np.mean(values):.2f} m" for scheme, values in printed.items()}
        found += [
            judge(
                f"gross errors {where} hurt WPO",
                mean(hurt),
                paper=theirs[WPO],
                ours=_words(walks, WPO, suffix),
                above=0.0,
            ),
            _unhurt(walks, f"gross errors {where} hardly reach MWPO", MWPO, suffix, theirs[MWPO]),
            judge(
                f"gross errors {where} hurt MWPO less than WPO",
                difference(hurt, spared),
                paper=f"{np.mean(printed[WPO]):.2f} → {np.mean(printed[MWPO]):.2f} m",
                ours=f"{mean(hurt).text()} m arrive in WPO, {mean(spared).text()} m in MWPO",
                above=0.0,
            ),
        ]
    found += [
        _unhurt(
            walks,
            "gross errors on P-O hardly reach MWPO when its particles walk by the EKF's velocity",
            BY_EKF,
            ON_ODOMETRY,
            f"residuals of {np.mean(TABLE_8_M[MWPO]):.2f} m",
        ),
        _unhurt(
            walks,
            "δS = 3 m keeps gross errors on Wi-Fi out of WPO, if what fails the test is dropped",
            WPO + DROPPED,
            ON_WIFI,
            "almost all are eliminated (section 4.4)",
        ),
    ]
    return found


def _unhurt(walks: Sequence[Walked], claim: str, scheme: str, suffix: str, paper: str) -> Claim:
    return judge(
        claim,
        mean(_arrived(walks, scheme, suffix)),
        paper=paper,
        ours=_words(walks, scheme, suffix),
        below=_BARELY_M,
    )


def _arrived(walks: Sequence[Walked], scheme: str, suffix: str) -> Floats:
    """Return by how much the gross errors raise the residuals of their epochs, (seeds,) metres."""
    added: Floats = (residuals_m(walks, scheme + suffix) - residuals_m(walks, scheme)).mean(axis=1)
    return added


def _words(walks: Sequence[Walked], scheme: str, suffix: str) -> str:
    with_errors, without = (residuals_m(walks, scheme + s).mean(axis=1) for s in (suffix, ""))
    return f"residuals of {mean(with_errors).text()} m, {mean(without).text()} m without them"
