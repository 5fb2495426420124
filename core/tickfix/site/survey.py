"""A survey: recordings with truth become a site, and the lessons that algorithms learn from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tickfix.api import Floor, Reader, ReaderError, Recording, SiteError, Survey
from tickfix.site.holdout import chains, is_held_out
from tickfix.site.legs import legs
from tickfix.site.radio import RadioMapBuilder
from tickfix.site.site import HeldOut, Site, SurveyTrack, digest_of
from tickfix.site.walks import survey_walk


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Surveyed:
    """What a survey gives: the site, still without models, and what to train them on (no held-out walk is in it)."""

    site: Site
    lessons: Survey


def survey(
    recordings: Iterable[Recording],
    floors: Sequence[Floor],
    *,
    name: str = "site",
    holdout: float = 0.0,
    spacing_m: float = 2.0,
    reach_m: float = 3.0,
    progress: Callable[[int, int], None] | None = None,
) -> Surveyed:
    """Survey a building.

    Args:
        recordings: its walks, in any order: the result does not depend on it. Those without waypoints are counted and
            left out.
        floors: plans, see :func:`floors_of`; a floor that is walked on but not given is there without a plan.
        name: of the site.
        holdout: share of the walks to keep for testing, see :mod:`tickfix.site.holdout`.
        spacing_m: width of the cells of which each that was walked through becomes a reference point.
        reach_m: of the radio map, see :class:`tickfix.api.RadioMap`: 0 for a survey that stood still at its points.
        progress: called as ``progress(done, total)`` after each surveyed walk.

    Raises:
        SiteError: when two walks share a name, two buildings share a floor's name, or no walk is left to survey.
    """
    walks = sorted(recordings, key=lambda recording: recording.name)
    _check(walks)
    chain_of = chains(walks)
    by_name = {recording.name: recording for recording in walks}
    held = [name for name, chain in chain_of.items() if is_held_out(chain, holdout)]
    kept = [by_name[name] for name in chain_of if name not in set(held)]
    if not kept:
        raise SiteError(
            f"survey: {len(walks)} walks, {len(chain_of)} with waypoints, {len(held)} held out: none is left to survey"
        )
    plans = _with_missing(floors, walks)
    numbers = {chain: i for i, chain in enumerate(sorted({chain_of[walk.name] for walk in kept}))}
    radio = RadioMapBuilder([floor.name for floor in plans], spacing_m=spacing_m, reach_m=reach_m)
    tracks: list[SurveyTrack] = []
    for done, walk in enumerate(kept, 1):
        parts, chain = legs(walk.truth), chain_of[walk.name]
        radio.add(walk, parts, numbers[chain])
        tracks += [SurveyTrack(walk=walk.name, floor=leg.floor, chain=chain, t_ns=leg.t_ns, xy=leg.xy) for leg in parts]
        if progress is not None:
            progress(done, len(kept))
    notes = radio.notes + Counter({"walks": len(kept), "walks held out": len(held)})
    notes["walks without waypoints"] = len(walks) - len(chain_of)
    for walk in walks:
        notes.update({f"rejected: {reason}": count for reason, count in walk.rejected.items()})
    radio_map = radio.build()
    site = Site(
        name=name,
        floors=plans,
        radio_map=radio_map,
        survey_tracks=tuple(tracks),
        held_out=tuple(_held_out(by_name[name], chain_of[name]) for name in held),
        notes={note: count for note, count in notes.items() if count},
    )
    lessons = tuple(survey_walk(walk, chain_of[walk.name]) for walk in kept)
    return Surveyed(site=site, lessons=Survey(floors=plans, radio_map=radio_map, walks=lessons))


def floors_of(reader: Reader, recordings: Iterable[Recording]) -> tuple[tuple[Floor, ...], tuple[str, ...]]:
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
    return _ordered(floors.values()), tuple(problems)


def _check(walks: Sequence[Recording]) -> None:
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


def _with_missing(floors: Sequence[Floor], walks: Sequence[Recording]) -> tuple[Floor, ...]:
    known = {floor.name for floor in floors}
    missing = sorted({truth.floor for walk in walks for truth in walk.truth} - known)
    return _ordered([*floors, *(Floor(name=name) for name in missing)])


def _ordered(floors: Iterable[Floor]) -> tuple[Floor, ...]:
    return tuple(sorted(floors, key=lambda floor: (floor.level, floor.name)))


def _held_out(walk: Recording, chain: str) -> HeldOut:
    if walk.path is None:
        return HeldOut(walk=walk.name, floor=walk.floor, chain=chain)
    path = walk.path.absolute()
    return HeldOut(walk=walk.name, floor=walk.floor, chain=chain, path=path, sha256=digest_of(path))
