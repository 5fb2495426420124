"""From recordings with truth to a site and the training data of algorithms.

The radio map has every reading at the place where it was heard.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tickfix.api import Floats, Floor, Ints, RadioMap, Reader, ReaderError, Recording, Scan, SiteError, Survey
from tickfix.site.site import HeldOutWalk, Site, file_sha256
from tickfix.site.waypoints import Leg, SurveyTrack, assign_chains, is_held_out, split_into_legs, to_survey_walk


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WalkReadings:
    """The readings of one walk, each (source, transmitter, time heard) once; t_ns (n,) int64, rssi_dbm (n,) float64."""

    transmitters: NDArray[np.str_]
    sources: NDArray[np.str_]
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
        heard = unique_readings(scans)
        self.notes["readings_repeated"] += sum(map(len, scans)) - len(heard.t_ns)
        self.notes["readings_before_first_waypoint"] += int((heard.t_ns < legs[0].t_ns[0]).sum())
        self.notes["readings_after_last_waypoint"] += int((heard.t_ns > legs[-1].t_ns[-1]).sum())
        inside = (heard.t_ns >= legs[0].t_ns[0]) & (heard.t_ns <= legs[-1].t_ns[-1])
        placed = 0
        for leg in legs:
            on_leg = leg.covers(heard.t_ns)
            placed += int(on_leg.sum())
            self._add_leg(heard, np.flatnonzero(on_leg), leg, chain)
        self.notes["readings_between_floors"] += int(inside.sum()) - placed

    def _add_leg(self, heard: WalkReadings, rows: Ints, leg: Leg, chain: int) -> None:
        self.notes["readings_kept"] += len(rows)
        for name, values in {
            "floor": np.full(len(rows), self._floors.index(leg.floor), dtype=np.int64),
            "transmitter": heard.transmitters[rows],
            "source": heard.sources[rows],
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
        ids, id_index = np.unique(columns.pop("transmitter"), return_inverse=True)
        sources, source_index = np.unique(columns.pop("source"), return_inverse=True)
        # The same id may be heard by two sources: a transmitter is the pair of both, in the order of ids.
        pairs, index = np.unique(id_index * len(sources) + source_index, return_inverse=True)
        cells = np.column_stack([columns.pop("floor"), np.floor(columns["sample_xy"] / self._spacing_m)])
        cells, point = np.unique(cells, axis=0, return_inverse=True)
        count = np.bincount(point)
        return RadioMap(
            floors=self._floors,
            transmitters=tuple(map(str, ids[pairs // len(sources)])),
            transmitter_source=tuple(map(str, sources[pairs % len(sources)])),
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


def unique_readings(scans: Sequence[Scan]) -> WalkReadings:
    """Return the readings of a walk sorted by (time heard, transmitter, source), the first delivered of each.

    Readings without a signal strength are left out: a radio map cannot use them.
    """
    first: dict[tuple[int, str, str], float] = {}
    for scan in scans:
        for transmitter, rssi_dbm, heard_ns in zip(
            scan.transmitters, scan.rssi_dbm.tolist(), scan.heard_ns.tolist(), strict=True
        ):
            if rssi_dbm == rssi_dbm:  # noqa: PLR0124 - not NaN
                first.setdefault((heard_ns, transmitter, scan.source), rssi_dbm)
    keys = sorted(first)
    return WalkReadings(
        transmitters=np.array([transmitter for _, transmitter, _ in keys], dtype=np.str_),
        sources=np.array([source for _, _, source in keys], dtype=np.str_),
        t_ns=np.array([heard_ns for heard_ns, _, _ in keys], dtype=np.int64),
        rssi_dbm=np.array([first[key] for key in keys], dtype=np.float64),
    )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SurveyResult:
    """What a survey gives: the site, still without models, and what to train them on (no held-out walk is in it)."""

    site: Site
    training_data: Survey


def survey_recordings(
    recordings: Iterable[Recording],
    floors: Sequence[Floor],
    *,
    name: str = "site",
    holdout: float = 0.0,
    spacing_m: float = 2.0,
    reach_m: float = 3.0,
    progress: Callable[[int, int], None] | None = None,
) -> SurveyResult:
    """Survey a building.

    Args:
        recordings: its walks, in any order: the result does not depend on it. Those without waypoints are counted and
            left out.
        floors: plans, see :func:`read_floor_plans`; a floor that is walked on but not given is there without a plan.
        name: of the site.
        holdout: share of the walks to keep for testing, see :mod:`tickfix.site.waypoints`.
        spacing_m: width of the cells of which each that was walked through becomes a reference point.
        reach_m: of the radio map, see :class:`tickfix.api.RadioMap`: 0 for a survey that stood still at its points.
        progress: called as ``progress(done, total)`` after each surveyed walk.

    Raises:
        SiteError: when two walks share a name, two buildings share a floor's name, or no walk is left to survey.
    """
    walks = sorted(recordings, key=lambda recording: recording.name)
    _check_unique(walks)
    chain_of = assign_chains(walks)
    by_name = {recording.name: recording for recording in walks}
    held = [name for name, chain in chain_of.items() if is_held_out(chain, holdout)]
    kept = [by_name[name] for name in chain_of if name not in set(held)]
    if not kept:
        raise SiteError(
            f"survey: {len(walks)} walks, {len(chain_of)} with waypoints, {len(held)} held out: none is left to survey"
        )
    plans = _add_missing_floors(floors, walks)
    numbers = {chain: i for i, chain in enumerate(sorted({chain_of[walk.name] for walk in kept}))}
    radio = RadioMapBuilder([floor.name for floor in plans], spacing_m=spacing_m, reach_m=reach_m)
    tracks: list[SurveyTrack] = []
    for done, walk in enumerate(kept, 1):
        parts, chain = split_into_legs(walk.truth), chain_of[walk.name]
        radio.add(walk, parts, numbers[chain])
        tracks += [SurveyTrack(walk=walk.name, floor=leg.floor, chain=chain, t_ns=leg.t_ns, xy=leg.xy) for leg in parts]
        if progress is not None:
            progress(done, len(kept))
    notes = radio.notes + Counter({"walks": len(kept), "walks_held_out": len(held)})
    notes["walks_without_waypoints"] = len(walks) - len(chain_of)
    for walk in walks:
        notes.update({f"rejected: {reason}": count for reason, count in walk.rejected.items()})
    radio_map = radio.build()
    site = Site(
        name=name,
        floors=plans,
        radio_map=radio_map,
        survey_tracks=tuple(tracks),
        held_out=tuple(_held_out_walk(by_name[name], chain_of[name]) for name in held),
        notes={note: count for note, count in notes.items() if count},
    )
    training_data = tuple(to_survey_walk(walk, chain_of[walk.name]) for walk in kept)
    return SurveyResult(site=site, training_data=Survey(floors=plans, radio_map=radio_map, walks=training_data))


def read_floor_plans(reader: Reader, recordings: Iterable[Recording]) -> tuple[tuple[Floor, ...], tuple[str, ...]]:
    """Return the plans of the floors that ``recordings`` were walked on, and what was wrong with broken ones.

    A floor whose plan is broken is there without geometry, so that fingerprints can still be surveyed.
    """
    floors: dict[str, Floor] = {}
    problems: list[str] = []
    for recording in recordings:
        if recording.path is None or not recording.floor or recording.floor in floors:
            continue
        try:
            plan = reader.floor(recording.path)
        except ReaderError as error:
            problems.append(str(error))
            plan = None
        floors[recording.floor] = Floor(name=recording.floor) if plan is None else plan
    return _sorted_floors(floors.values()), tuple(problems)


def _check_unique(walks: Sequence[Recording]) -> None:
    names: dict[str, Path | None] = {}
    folders: dict[str, Path] = {}
    for walk in walks:
        if walk.name in names:
            raise SiteError(
                f"survey: two walks are called {walk.name} ({names[walk.name]}, {walk.path}); rename or leave out one"
            )
        names[walk.name] = walk.path
        if walk.path is None or not walk.floor:
            continue
        folder = walk.path.absolute().parent
        if folders.setdefault(walk.floor, folder) != folder:
            raise SiteError(
                f"survey: walks of floor {walk.floor!r} lie in {folders[walk.floor]} and in {folder}; "
                "survey one building at a time, or bring the walks of a floor together in one folder"
            )


def _add_missing_floors(floors: Sequence[Floor], walks: Sequence[Recording]) -> tuple[Floor, ...]:
    known = {floor.name for floor in floors}
    missing = sorted({truth.floor for walk in walks for truth in walk.truth} - known)
    return _sorted_floors([*floors, *(Floor(name=name) for name in missing)])


def _sorted_floors(floors: Iterable[Floor]) -> tuple[Floor, ...]:
    return tuple(sorted(floors, key=lambda floor: (floor.level, floor.name)))


def _held_out_walk(walk: Recording, chain: str) -> HeldOutWalk:
    if walk.path is None:
        return HeldOutWalk(walk=walk.name, floor=walk.floor, chain=chain)
    path = walk.path.absolute()
    return HeldOutWalk(walk=walk.name, floor=walk.floor, chain=chain, path=path, sha256=file_sha256(path))
