"""Who surveys the twin's site and who walks in it: standing at reference points, calibrating, and the test itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tickfix.api import Floats, RadioMap, Rng, Survey, frozen
from tickfix.reproduction.wang2015.site import CALIBRATION, FLOOR, ROUTE, draw_building, reference_points
from tickfix.simulation import (
    START_NS,
    Building,
    Hold,
    Logging,
    Phone,
    Receiver,
    SimulatedWalk,
    Trajectory,
    Walkable,
    Walker,
    draw_phone,
    draw_walker,
    route_through,
    simulate_walk,
    walkable,
)
from tickfix.simulation.scanning import scan
from tickfix.site.walks import survey_walk

FIX_S: Final = 2.0
"""RSSI is collected once every 2 s, [wang2015] section 3.3."""
DIRECTIONS: Final = 4
SCANS: Final = 2
"""At a reference point the surveyor faces four directions and takes two measurements in each."""
_SCAN_S: Final = 0.15  # within one tick: the paper's epochs are instants
RECEIVER: Final = Receiver(
    scan_s=(_SCAN_S, _SCAN_S), pause_s=(FIX_S - _SCAN_S, FIX_S - _SCAN_S), delivery_s=(0.0, 0.0), stale_s=0.0
)
_HOUR_NS: Final = 3_600_000_000_000


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Twin:
    """What one seed draws.

    Attributes:
        building: the site.
        survey: what algorithms learn from: the radio map of a survey that stood still, and three calibration walks.
        walk: the test.
    """

    building: Building
    survey: Survey
    walk: SimulatedWalk


def draw_twin(seed: int) -> Twin:
    """Draw the building's fields, the person and the phone, and let them survey, calibrate and walk."""
    site_rng, person_rng, survey_rng, walk_rng = np.random.default_rng([seed, 2015]).spawn(4)
    building = draw_building(site_rng)
    walker, phone = _steady(draw_walker(person_rng)), _galaxy(draw_phone(person_rng))
    ground = walkable(building.floor(FLOOR))
    *calibration, test = [
        _walk(building, ground, places, rng, name, walker, phone, START_NS + (n + 1) * _HOUR_NS)
        for n, (name, places, rng) in enumerate(
            zip(
                ("calibration-1", "calibration-2", "calibration-3", "test"),
                (*CALIBRATION, ROUTE),
                walk_rng.spawn(len(CALIBRATION) + 1),
                strict=True,
            )
        )
    ]
    # Fingerprints number the chains of walks by name and learn how far off they are on each without its own samples.
    # The standing survey is a chain of its own, after those of the walks.
    radio_map = stand_at_points(building, reference_points(), survey_rng, chain=len(calibration))
    lessons = Survey(
        floors=building.floors,
        radio_map=radio_map,
        walks=tuple(survey_walk(walk.recording, walk.recording.name) for walk in calibration),
    )
    return Twin(building=building, survey=lessons, walk=test)


def stand_at_points(building: Building, points: Floats, rng: Rng, *, chain: int) -> RadioMap:
    """Return the radio map of a surveyor who stands at each of ``points`` (P, 2), facing one direction after another.

    Args:
        building: where.
        points: (P, 2) metres.
        rng: draws fading and what is missed.
        chain: number of the survey among the chains of walks.
    """
    names = [ap.name for ap in building.access_points]
    order = np.argsort(names, kind="stable")
    column = np.empty(len(names), np.int64)
    column[order] = np.arange(len(names))
    rows: list[Floats] = []
    times: list[np.ndarray] = []
    for point, (xy, point_rng) in enumerate(zip(points, rng.spawn(len(points)), strict=True)):
        for turn, turn_rng in enumerate(point_rng.spawn(DIRECTIONS)):
            begin_s = (point * DIRECTIONS + turn) * (SCANS + 1) * FIX_S
            standing = _standing(xy, 2.0 * np.pi * turn / DIRECTIONS, SCANS * FIX_S + 0.1)
            for heard in scan(standing, building.floor(FLOOR), building.radio, RECEIVER, turn_rng):
                rows.append(
                    np.column_stack([np.full(len(heard.heard_s), point), column[heard.access_point], heard.rssi_dbm])
                )
                times.append(START_NS + np.rint((begin_s + heard.heard_s) * 1e9).astype(np.int64))
    samples = np.concatenate(rows)
    point_of = samples[:, 0].astype(np.int64)
    return RadioMap(
        floors=(FLOOR,),
        transmitters=tuple(names[i] for i in order),
        point_floor=frozen(np.zeros(len(points)), np.int64),
        point_xy=points,
        sample_point=frozen(point_of, np.int64),
        sample_transmitter=frozen(samples[:, 1], np.int64),
        sample_rssi_dbm=frozen(samples[:, 2]),
        sample_xy=frozen(points[point_of]),
        sample_t_ns=frozen(np.concatenate(times), np.int64),
        sample_chain=frozen(np.full(len(samples), chain), np.int64),
    )


def _standing(xy: Floats, heading_rad: float, seconds: float) -> Trajectory:
    t = np.array([0.0, seconds])
    still = np.zeros(2)
    return Trajectory(
        t_s=t,
        way_m=still,
        xy=np.stack([xy, xy]),
        heading_rad=still + heading_rad,
        speed_mps=still,
        phase=still,
        swing_mps2=still,
    )


def _walk(
    building: Building,
    ground: Walkable,
    places: Sequence[tuple[float, float]],
    rng: Rng,
    name: str,
    walker: Walker,
    phone: Phone,
    start_ns: int,
) -> SimulatedWalk:
    return simulate_walk(
        building,
        route_through(ground, np.array(places)),
        rng,
        name=name,
        walker=walker,
        phone=phone,
        receiver=RECEIVER,
        logging=Logging(waypoint_m=3.0),
        start_ns=start_ns,
    )


def _steady(walker: Walker) -> Walker:
    """Return the walker with "a uniform and stable gait", who holds the phone "as stable as possible"."""
    hold = Hold(pitch_rad=walker.hold.pitch_rad, sway_rad=0.02, wander_rad=0.01)
    return replace(walker, pauses_per_m=0.0, hold=hold)


def _galaxy(phone: Phone) -> Phone:
    """Return the phone with the noise that Table 3 prints for the Galaxy S4."""
    return replace(phone, accelerometer_noise_mps2=0.0006, gyroscope_noise_rad_s=0.0003, magnetometer_noise_ut=0.06)
