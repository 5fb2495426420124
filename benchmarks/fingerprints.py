"""Every registered fingerprint method, with each of its presets, on the public fingerprint sets.

Run ``python benchmarks/fingerprints.py``; the data are found through TICKFIX_DATA, else ``../shared/data``. Errors are
horizontal, in metres, over all fixes whatever their floor; *floor* says how many are on the right one. ``(centre)`` is
the trivial baseline: the middle of all reference points, whatever is heard.

Each method sees the window it asks for: of the scans made at one place one after the other, as many and as old as its
own parameters say. The rooms' scans carry no times; they are taken as 2 s apart.
"""

from __future__ import annotations

import argparse
import csv
import gzip
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from tickfix.api import Context, Floats, Ints, RadioMap, Readings, Survey, frozen
from tickfix.kernel.determinism import RandomStreams
from tickfix.registry import discover

ROOMS = ("office", "corridor", "lecture_theatre")
MONTHS = ("01", "02", "03")
CELL_M = 0.6
SECOND_NS = 10**9


@dataclass(frozen=True, kw_only=True)
class Scans:
    """Scans with truth: rssi_dbm (n, M), NaN where not heard; xy (n, 2) metres; floor (n,); t_ns (n,)."""

    rssi_dbm: Floats
    xy: Floats
    floor: Ints
    t_ns: Ints

    @property
    def place(self) -> Ints:
        """(n,) numbers of the runs of scans at one place."""
        here = np.column_stack([self.floor, self.xy])
        return np.cumsum(np.r_[True, (np.diff(here, axis=0) != 0).any(axis=1)]) - 1


@dataclass(frozen=True, kw_only=True)
class Score:
    """What a method did on a set; errors (n,) metres of the fixes."""

    method: str
    errors_m: Floats
    right_floor: float
    without_fix: int
    ms: float


def library(folder: Path, month: str, name: str) -> Scans:
    """Read a campaign of the uji-library set, such as ``trn01``."""
    rssi, where, times = (_rows(folder / "db" / month / f"{name}{kind}.csv.gz") for kind in ("rss", "crd", "tms"))
    place = np.array(where, np.float64)
    t_ns = [
        round(datetime.strptime(row[0][:14], "%Y%m%d%H%M%S").replace(tzinfo=UTC).timestamp()) * SECOND_NS
        + int(row[0][14:] or 0) * 10**6
        for row in times
    ]
    heard = np.array(rssi, np.float64)
    return Scans(
        rssi_dbm=np.where(heard == 100, np.nan, heard),
        xy=place[:, :2],
        floor=place[:, 2].astype(np.int64),
        t_ns=np.array(t_ns, np.int64),
    )


def room(folder: Path, name: str, part: str) -> Scans:
    """Read ``train`` or ``test`` of a room of the wifi-rss-rtt set."""
    header, *rows = _rows(folder / "data" / f"database_{name}_{part}.csv")
    rss = [n for n, column in enumerate(header) if "RSS" in column]
    heard = np.array([[row[n] for n in rss] for row in rows], np.float64)
    xy = CELL_M * np.array([row[:2] for row in rows], np.float64)
    return Scans(
        rssi_dbm=np.where(heard <= -200, np.nan, heard),
        xy=xy,
        floor=np.zeros(len(rows), np.int64),
        t_ns=2 * SECOND_NS * np.arange(1, len(rows) + 1),
    )


def radio_map(scans: Scans) -> RadioMap:
    """Return a survey that stood still at its points."""
    points, point = np.unique(np.column_stack([scans.floor, scans.xy]), axis=0, return_inverse=True)
    floors, floor = np.unique(points[:, 0], return_inverse=True)
    scan, transmitter = np.nonzero(~np.isnan(scans.rssi_dbm))
    return RadioMap(
        floors=tuple(f"floor {int(f)}" for f in floors),
        transmitters=_names(scans),
        point_floor=floor,
        point_xy=points[:, 1:],
        sample_point=point.ravel()[scan],
        sample_transmitter=transmitter,
        sample_rssi_dbm=scans.rssi_dbm[scan, transmitter],
        sample_xy=scans.xy[scan],
        sample_t_ns=scans.t_ns[scan],
        sample_chain=np.zeros(len(scan), np.int64),
    )


def window(scans: Scans, n: int, method: Any) -> Readings:
    """Return the window that a method asks for, ending with scan ``n``."""
    names, wanted, place = _names(scans), method.window, scans.place
    age_ns = scans.t_ns[n] - scans.t_ns[: n + 1]
    mine = np.flatnonzero((place[: n + 1] == place[n]) & (age_ns <= wanted.seconds * 1e9))[-wanted.scans :]
    scan, transmitter = np.nonzero(~np.isnan(scans.rssi_dbm[mine]))
    return Readings(
        t_ns=int(scans.t_ns[n]),
        transmitters=tuple(names[i] for i in transmitter),
        rssi_dbm=frozen(scans.rssi_dbm[mine][scan, transmitter]),
        heard_ns=frozen(scans.t_ns[mine][scan], np.int64),
        scan=frozen(scan, np.int64),
        scan_t_ns=tuple(scans.t_ns[mine].tolist()),
    )


def compare(survey: Scans, queries: Scans, most: int) -> Iterator[Score]:
    """Yield the baseline's score and then each method's, on at most ``most`` queries spread over the set."""
    site = radio_map(survey)
    asked = np.unique(np.linspace(0, len(queries.xy) - 1, most).astype(np.int64))
    off = np.hypot(*(queries.xy[asked] - site.point_xy.mean(axis=0)).T)
    yield Score(method="(centre)", errors_m=off, right_floor=np.nan, without_fix=0, ms=0.0)
    for label, cls, params in methods():
        survey_of = Survey(floors=(), radio_map=site, walks=())
        trained = cls.train(params, survey_of, RandomStreams(0, "benchmark").at(0, 0, cls.name))
        method = cls(params, Context(radio_map=site), trained)
        windows = [window(queries, n, method) for n in asked]
        begun = time.perf_counter()
        fixes = [method.locate(one) for one in windows]
        ms = 1e3 * (time.perf_counter() - begun) / len(asked)
        found = [(n, fix) for n, fix in zip(asked, fixes, strict=True) if fix is not None]
        yield Score(
            method=label,
            errors_m=np.array([np.hypot(*(fix.xy - queries.xy[n])) for n, fix in found]),
            right_floor=float(np.mean([fix.floor == f"floor {queries.floor[n]}" for n, fix in found])),
            without_fix=len(asked) - len(found),
            ms=ms,
        )


def methods() -> Iterator[tuple[str, Any, Any]]:
    """Yield label, class and parameters of every registered fingerprint that trains, plain and with each preset."""
    for offer in discover().offers:
        if offer.kind == "fingerprint" and hasattr(offer.cls, "train"):
            yield offer.name, offer.cls, offer.cls.Params()
            for name, preset in offer.cls.presets.items():
                yield f"{offer.name} {name}", offer.cls, offer.cls.Params(**preset.values)


def sets(data: Path) -> Iterator[tuple[str, Scans, Scans]]:
    """Yield name, survey and queries of every set."""
    for month in MONTHS:
        folder = data / "uji-library"
        yield f"library, month {month}", library(folder, month, "trn01"), library(folder, month, "tst01")
    for name in ROOMS:
        yield f"{name}", room(data / "wifi-rss-rtt", name, "train"), room(data / "wifi-rss-rtt", name, "test")


def main() -> None:
    """Print the comparison."""
    told = os.environ.get("TICKFIX_DATA")
    here = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--data", type=Path, default=Path(told) if told else here, help="folder of the sets")
    parser.add_argument("--queries", type=int, default=200, help="per set, spread over it (200)")
    options = parser.parse_args()
    for name, survey, queries in sets(options.data):
        print(f"\n{name}: {len(survey.xy)} survey scans, at most {options.queries} of {len(queries.xy)} queries")
        print(f"{'method':<22}{'mean':>7}{'median':>8}{'p75':>7}{'floor':>8}{'no fix':>8}{'ms':>8}")
        for score in compare(survey, queries, options.queries):
            e = score.errors_m
            figures = f"{e.mean():7.2f}{np.median(e):8.2f}{np.quantile(e, 0.75):7.2f}"
            floor = "–" if np.isnan(score.right_floor) else f"{score.right_floor:.1%}"
            print(f"{score.method:<22}{figures}{floor:>8}{score.without_fix:8d}{score.ms:8.2f}", flush=True)


def _rows(path: Path) -> list[list[str]]:
    with gzip.open(path, "rt") if path.suffix == ".gz" else path.open(newline="") as file:
        return list(csv.reader(file))


def _names(scans: Scans) -> tuple[str, ...]:
    return tuple(f"{n:04d}" for n in range(scans.rssi_dbm.shape[1]))


if __name__ == "__main__":
    main()
