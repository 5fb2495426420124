"""The twin of [jiang2015]'s experiment: what was recorded off line, and the walks that are tracked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tickfix.api import Floats, Floor, RadioMap, Recording, Rng, Survey, SurveyWalk, Truth
from tickfix.reproduction.jiang2015.people import PACES, Handset, draw_handsets, draw_people, walking
from tickfix.reproduction.jiang2015.site import FLOOR, building, fingerprint_points, route
from tickfix.simulation import START_NS, Building, Logging, SimulatedWalk, Trajectory, simulate_walk
from tickfix.simulation.scanning import scan
from tickfix.site.walks import survey_walk

REGISTRATIONS: Final = 4
SCANS: Final = 3
_LABEL_M: Final = 2.0
_TAP_S: Final = 0.1
_STAND_S: Final = 12.0
_HOUR_NS: Final = 3_600_000_000_000


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Twin:
    """One draw of the experiment.

    Attributes:
        floor: the room.
        lessons: radio map of 36 points and 20 labelled walks.
        walks: one of each person, with the phone that surveyed the Wi-Fi, later.
    """

    floor: Floor
    lessons: Survey
    walks: tuple[SimulatedWalk, ...]


def twin(seed: int) -> Twin:
    """Draw the room's radio, the people and their phones, and let them walk; the same seed gives the same bytes."""
    site_rng, who_rng, radio_rng, train_rng, test_rng = np.random.default_rng([2015, seed]).spawn(5)
    site = building(site_rng)
    people, handsets = draw_people(who_rng), draw_handsets(who_rng)
    way = route()
    lessons = []
    for p, person in enumerate(people):
        for n, pace in enumerate(PACES):
            rng, name = train_rng.spawn(1)[0], f"train-{p}-{n}"
            walk = simulate_walk(
                site,
                way,
                rng,
                name=name,
                walker=walking(person, pace, rng),
                phone=handsets[(p + n) % len(handsets)].phone,
                receiver=handsets[(p + n) % len(handsets)].receiver,
                logging=Logging(waypoint_m=_LABEL_M),
                start_ns=START_NS + (p * len(PACES) + n) * _HOUR_NS,
            )
            lessons.append(_labelled(walk.recording, rng))
    walks = []
    for p, person in enumerate(people):
        rng = test_rng.spawn(1)[0]
        walks.append(
            simulate_walk(
                site,
                way,
                rng,
                name=f"test-{p}",
                walker=walking(person, 1.0, rng),
                phone=handsets[0].phone,
                receiver=handsets[0].receiver,
                start_ns=START_NS + (100 + p) * _HOUR_NS,
            )
        )
    radio_map = _radio_map(site, handsets[0], radio_rng)
    survey = Survey(floors=site.floors, radio_map=radio_map, walks=tuple(lessons))
    return Twin(floor=site.floors[0], lessons=survey, walks=tuple(walks))


def _labelled(recording: Recording, rng: Rng) -> SurveyWalk:
    """Return a walk as the regression learns from it: with labels at the volume key's times, without Wi-Fi."""
    walk = survey_walk(recording, recording.name)
    late_ns = np.rint(1e9 * _TAP_S * rng.standard_normal(len(walk.truth))).astype(np.int64).tolist()
    truth: list[Truth] = [replace(t, t_ns=t.t_ns + late) for t, late in zip(walk.truth, late_ns, strict=True)]
    return replace(walk, truth=tuple(sorted(truth, key=lambda t: t.t_ns)), scans=())


def _radio_map(site: Building, handset: Handset, rng: Rng) -> RadioMap:
    """Return the fingerprints: at each point four registrations, each the mean of three scans, facing four ways."""
    points = fingerprint_points()
    names = [ap.name for ap in site.access_points]
    columns: list[tuple[int, int, int, float]] = []
    for point, xy in enumerate(points):
        for registration in range(REGISTRATIONS):
            standing = _standing(xy, np.pi / 2.0 * registration)
            heard = scan(standing, site.floors[0], site.radio, handset.receiver, rng.spawn(1)[0])[:SCANS]
            access_point = np.concatenate([h.access_point for h in heard])
            rssi_dbm = np.concatenate([h.rssi_dbm for h in heard])
            count = np.bincount(access_point, minlength=len(names))
            total = np.bincount(access_point, rssi_dbm, minlength=len(names))
            columns += [(point, int(ap), registration, float(total[ap] / count[ap])) for ap in np.flatnonzero(count)]
    point_of, transmitter, chain, rssi = (np.array(column) for column in zip(*columns, strict=True))
    return RadioMap(
        floors=(FLOOR,),
        transmitters=tuple(names),
        point_floor=np.zeros(len(points), np.int64),
        point_xy=points,
        sample_point=point_of,
        sample_transmitter=transmitter,
        sample_rssi_dbm=rssi,
        sample_xy=points[point_of],
        sample_t_ns=START_NS - _HOUR_NS + 60_000_000_000 * (REGISTRATIONS * point_of + chain),
        sample_chain=chain,
    )


def _standing(xy: Floats, heading_rad: float) -> Trajectory:
    """Return the trajectory of somebody who stands at a place (2,) for as long as three scans can take."""
    t_s = np.array([0.0, _STAND_S])
    still = np.zeros(2)
    return Trajectory(
        t_s=t_s,
        way_m=still,
        xy=np.array([xy, xy]),
        heading_rad=np.full(2, heading_rad),
        speed_mps=still,
        phase=still,
        swing_mps2=still,
    )
