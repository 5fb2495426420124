"""The radio map of a survey: every reading at the place where it was heard."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tickfix.api import Floats, Ints, RadioMap, Recording, Scan
from tickfix.site.legs import Leg
from tickfix.site.points import reference_points

SPACING_NS = 5_000_000_000
"""Where a walk heard beacons only, one of them in this time stands for a scan."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Heard:
    """The readings of one walk, each (transmitter, time heard) once; t_ns (n,) int64, rssi_dbm (n,) float64."""

    transmitters: NDArray[np.str_]
    t_ns: Ints
    rssi_dbm: Floats


class RadioMapBuilder:
    """Collects walk after walk; counts in ``notes`` what became of their readings."""

    def __init__(self, floors: Sequence[str], *, point_window_s: float, reach_m: float) -> None:
        self.notes: Counter[str] = Counter()
        self._floors = tuple(floors)
        self._window_s = point_window_s
        self._reach_m = reach_m
        self._points = 0
        self._columns: dict[str, list[NDArray[Any]]] = {}

    def add(self, recording: Recording, legs: Sequence[Leg], chain: int) -> None:
        """Add the readings that ``recording`` heard on its ``legs``; ``chain`` is the number of its chain."""
        scans = [event for event in recording.events if isinstance(event, Scan)]
        heard = heard_once(scans)
        self.notes["readings repeated by later scans"] += sum(map(len, scans)) - len(heard.t_ns)
        self.notes["readings before the first waypoint"] += int((heard.t_ns < legs[0].t_ns[0]).sum())
        self.notes["readings after the last waypoint"] += int((heard.t_ns > legs[-1].t_ns[-1]).sum())
        inside = (heard.t_ns >= legs[0].t_ns[0]) & (heard.t_ns <= legs[-1].t_ns[-1])
        placed = 0
        for leg in legs:
            on_leg = leg.covers(heard.t_ns)
            placed += int(on_leg.sum())
            self._add_leg(heard, np.flatnonzero(on_leg), leg, scans, chain)
        self.notes["readings between floors"] += int(inside.sum()) - placed

    def _add_leg(self, heard: Heard, rows: Ints, leg: Leg, scans: Sequence[Scan], chain: int) -> None:
        xy = leg.at(heard.t_ns[rows])
        times = scan_times(scans)
        times = times[leg.covers(times)]
        points = reference_points(heard.t_ns[rows], xy, times, point_window_s=self._window_s)
        kept = points.of_reading >= 0
        self.notes["readings far from any scan"] += int((~kept).sum())
        self.notes["readings kept"] += int(kept.sum())
        floor = self._floors.index(leg.floor)
        for name, values in {
            "point_floor": np.full(len(points.xy), floor, dtype=np.int64),
            "point_xy": points.xy,
            "sample_point": points.of_reading[kept] + self._points,
            "transmitter": heard.transmitters[rows][kept],
            "sample_rssi_dbm": heard.rssi_dbm[rows][kept],
            "sample_xy": xy[kept],
            "sample_t_ns": heard.t_ns[rows][kept],
            "sample_chain": np.full(int(kept.sum()), chain, dtype=np.int64),
        }.items():
            self._columns.setdefault(name, []).append(values)
        self._points += len(points.xy)

    def build(self) -> RadioMap:
        """Return the map of all walks added."""
        if not self._columns:
            return empty_radio_map(self._floors)
        columns: dict[str, Any] = {name: np.concatenate(parts) for name, parts in self._columns.items()}
        transmitters, index = np.unique(columns.pop("transmitter"), return_inverse=True)
        return RadioMap(
            floors=self._floors,
            transmitters=tuple(map(str, transmitters)),
            sample_transmitter=index.astype(np.int64),
            reach_m=self._reach_m,
            **columns,
        )


def empty_radio_map(floors: Sequence[str]) -> RadioMap:
    """Return a map without points."""
    no, none = np.zeros(0, dtype=np.int64), np.zeros((0, 2))
    return RadioMap(
        floors=tuple(floors),
        transmitters=(),
        point_floor=no,
        point_xy=none,
        sample_point=no,
        sample_transmitter=no,
        sample_rssi_dbm=np.zeros(0),
        sample_xy=none,
        sample_t_ns=no,
        sample_chain=no,
    )


def heard_once(scans: Sequence[Scan]) -> Heard:
    """Return the readings of a walk sorted by (time heard, transmitter), the first delivered of each pair."""
    first: dict[tuple[int, str], float] = {}
    for scan in scans:
        for transmitter, rssi_dbm, heard_ns in zip(
            scan.transmitters, scan.rssi_dbm.tolist(), scan.heard_ns.tolist(), strict=True
        ):
            first.setdefault((heard_ns, transmitter), rssi_dbm)
    keys = sorted(first)
    return Heard(
        transmitters=np.array([transmitter for _, transmitter in keys], dtype=np.str_),
        t_ns=np.array([heard_ns for heard_ns, _ in keys], dtype=np.int64),
        rssi_dbm=np.array([first[key] for key in keys], dtype=np.float64),
    )


def scan_times(scans: Sequence[Scan]) -> Ints:
    """Return the distinct times (m,) around which reference points are made, increasing.

    Beacons are heard one by one, many a second: they make no points of their own unless there is no Wi-Fi.
    """
    wifi = sorted({scan.t_ns for scan in scans if scan.source == "wifi"})
    if wifi:
        return np.array(wifi, dtype=np.int64)
    spaced: list[int] = []
    for t_ns in sorted({scan.t_ns for scan in scans}):
        if not spaced or t_ns - spaced[-1] >= SPACING_NS:
            spaced.append(t_ns)
    return np.array(spaced, dtype=np.int64)
