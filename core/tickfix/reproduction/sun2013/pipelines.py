"""The systems of [sun2013] as pipelines: three fingerprints, each alone, + map, + KF and + KMF; variants of FNCC."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from tickfix.reproduction.sun2013.choices import POINTS_AVERAGED, SURFACE_K, SURFACE_N

KNN: Final = "KNN"
WKNN: Final = "WKNN"
FNCC: Final = "FNCC"
FINGERPRINTS: Final = (KNN, WKNN, FNCC)
ALONE: Final = ""
MAP: Final = " + Map"
KF: Final = " + KF"
KMF: Final = " + KMF"
SYSTEMS: Final = tuple(f"{fingerprint}{aid}" for aid in (ALONE, MAP, KF, KMF) for fingerprint in FINGERPRINTS)

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
        KF: 'filter = { use = "kalman-map", preset = "sun2013" }',
        KMF: f'filter = {{ use = "kalman-map", preset = "sun2013" }}\nmap = {image}',
    }
    tables = [
        _table(f"{name}{aid}", method, filter_) for aid, filter_ in aids.items() for name, method in _METHODS.items()
    ]
    tables += [_table(name, method) for name, method in _VARIANTS.items()]
    for n in SURFACE_N:
        fncc = f'{{ use = "fncc", preset = "sun2013", n = {n}, {_CORRELATION} }}'
        tables.append(_table(surface(FNCC, n, POINTS_AVERAGED), fncc))
        for k in SURFACE_K:
            knn = f'{{ use = "knn", preset = "sun2013", n = {n}, k = {k}, {_SHARED} }}'
            tables.append(_table(surface(KNN, n, k), knn))
    return "\n".join(tables)


def surface(fingerprint: str, n: int, k: int) -> str:
    """Return the name of the pipeline for one point of figure 4."""
    return f"{fingerprint} N={n} K={k}"


def _table(name: str, fingerprint: str, filter_: str = 'filter = "fixes"') -> str:
    return f'[pipelines."{name}"]\nfingerprint = {fingerprint}\n{filter_}\n'
