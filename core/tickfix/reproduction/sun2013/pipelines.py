"""The systems of [sun2013] as pipelines: three fingerprints, each alone, + map, + KF and + KMF; variants of FNCC."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from tickfix.reproduction.sun2013 import choices

KNN: Final = "KNN"
WKNN: Final = "WKNN"
FNCC: Final = "FNCC"
FINGERPRINTS: Final = (KNN, WKNN, FNCC)
ALONE: Final = ""
MAP: Final = " + Map"
KF: Final = " + KF"
KMF: Final = " + KMF"
AIDS: Final = (ALONE, MAP, KF, KMF)
AGILE: Final = "0.5 m/s²: "
"""Before the name of a system whose filter lets the walker accelerate ten times as much as printed."""

NCC: Final = "NCC (1), blocks"
NCC_OF_MEANS: Final = "NCC (1), means"
LITERAL: Final = "FNCC (6) as printed"
FNCC_OF_MEANS: Final = "FNCC (6), means"
LITERAL_OF_MEANS: Final = "FNCC (6) as printed, means"
POOLED: Final = "FNCC (6), mean of blocks"

# A sample of the survey is one scan of half a second. However little is heard, there is a result.
_SHARED: Final = "min_readings = 1"
_CORRELATION: Final = f"{_SHARED}, sample_s = 0.5"
_METHODS: Final = {
    KNN: f'{{ use = "knn", preset = "sun2013", {_SHARED} }}',
    WKNN: f'{{ use = "wknn", preset = "sun2013", {_SHARED} }}',
    FNCC: f'{{ use = "fncc", preset = "sun2013", {_CORRELATION} }}',
}
_VARIANTS: Final = {
    POOLED: f'{{ use = "fncc", preset = "sun2013", pool = "mean", {_CORRELATION} }}',
    FNCC_OF_MEANS: f'{{ use = "fncc", preset = "sun2013", reference = "mean", {_CORRELATION} }}',
    LITERAL: f'{{ use = "fncc", preset = "literal", {_CORRELATION} }}',
    LITERAL_OF_MEANS: f'{{ use = "fncc", preset = "literal", reference = "mean", {_CORRELATION} }}',
    NCC: f'{{ use = "ncc", preset = "sun2013", {_CORRELATION} }}',
    NCC_OF_MEANS: f'{{ use = "ncc", preset = "sun2013", reference = "mean", {_CORRELATION} }}',
}


def configuration(plan: Path, plan_with_walkways: Path) -> str:
    """Return the TOML of all pipelines; the two drawings are those of eq. (7)."""
    image = f'{{ use = "image", preset = "sun2013", plan = "{plan}", plan_with_walkways = "{plan_with_walkways}" }}'
    aids = {
        ALONE: 'filter = "fixes"',
        MAP: f'filter = {{ use = "fixes", matched = true }}\nmap = {image}',
        KF: _kalman(),
        KMF: f"{_kalman()}\nmap = {image}",
    }
    tables = [
        _table(f"{name}{aid}", method, filter_) for aid, filter_ in aids.items() for name, method in _METHODS.items()
    ]
    tables += [_table(name, method) for name, method in _VARIANTS.items()]
    agile = _kalman(", acceleration_mps2 = 0.5")
    tables.append(_table(f"{AGILE}{FNCC}{KF}", _METHODS[FNCC], agile))
    tables.append(_table(f"{AGILE}{FNCC}{KMF}", _METHODS[FNCC], f"{agile}\nmap = {image}"))
    for n in choices.SURFACE_N:
        fncc = f'{{ use = "fncc", preset = "sun2013", n = {n}, {_CORRELATION} }}'
        tables.append(_table(surface(FNCC, n, choices.POINTS_AVERAGED), fncc))
        for k in choices.SURFACE_K:
            knn = f'{{ use = "knn", preset = "sun2013", n = {n}, k = {k}, {_SHARED} }}'
            tables.append(_table(surface(KNN, n, k), knn))
    return "\n".join(tables)


def surface(fingerprint: str, n: int, k: int) -> str:
    """Return the name of the pipeline for one point of figure 4."""
    return f"{fingerprint} N={n} K={k}"


def _kalman(parameters: str = "") -> str:
    return f'filter = {{ use = "kalman-map", preset = "sun2013"{parameters} }}'


def _table(name: str, fingerprint: str, filter_: str = 'filter = "fixes"') -> str:
    return f'[pipelines."{name}"]\nfingerprint = {fingerprint}\n{filter_}\n'
