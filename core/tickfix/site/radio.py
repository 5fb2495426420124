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


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Heard:
    """The readings of one walk, each (transmitter, time heard) once; t_ns (n,) int64, rssi_dbm (n,) float64."""

    transmitters: NDArray[np.str_]
    t_ns: Ints
    rssi_dbm: Floats


class RadioMapBuilder:
    """Collects walk after walk; counts in ``notes`` what became of their readings."""

    def __init__(self, floors: Sequence[str], *, spacing_m: float, reach_m: float) -> None:
        self.notes: Counter[str] = Counter()
        self._floors = tuple(floors)
        self._spacing_m = spacing_m
        self._reach_m = reach_m
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
            self._add_leg(heard, np.flatnonzero(on_leg), leg, chain)
        self.notes["readings between floors"] += int(inside.sum()) - placed

    def _add_leg(self, heard: Heard, rows: Ints, leg: Leg, chain: int) -> None:
        self.notes["readings kept"] += len(rows)
        for name, values in {
            "floor": np.full(len(rows), self._floors.index(leg.floor), dtype=np.int64),
            "transmitter": heard.transmitters[rows],
            "sample_rssi_dbm": heard.rssi_dbm[rows],
            "sample_xy": leg.at(heard.t_ns[rows]),
            "sample_t_ns": heard.t_ns[rows],
            "sample_chain": np.full(len(rows), chain, dtype=np.int64),
        }.items():
            self._columns.setdefault(name, []).append(values)

    def build(self) -> RadioMap:
        """Return the map of all walks added.

        A reference point stands in every cell of a square grid in which something was heard, at the mean place of what
        was: walks that pass one place many times make one good point of it, where a point per scan would make many
        poor ones, and a nearest-neighbour method would find the same corner several times.
        """
        if not self._columns or not sum(map(len, self._columns["floor"])):
            return empty_radio_map(self._floors)
        columns: dict[str, Any] = {name: np.concatenate(parts) for name, parts in self._columns.items()}
        transmitters, index = np.unique(columns.pop("transmitter"), return_inverse=True)
        cells = np.column_stack([columns.pop("floor"), np.floor(columns["sample_xy"] / self._spacing_m)])
        cells, point = np.unique(cells, axis=0, return_inverse=True)
        count = np.bincount(point)
        return RadioMap(
            floors=self._floors,
            transmitters=tuple(map(str, transmitters)),
            point_floor=cells[:, 0].astype(np.int64),
            point_xy=np.column_stack([np.bincount(point, weights=xy) / count for xy in columns["sample_xy"].T]),
            sample_point=point.astype(np.int64),
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
