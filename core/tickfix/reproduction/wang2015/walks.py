"""Who surveys the twin's site and who walks in it: standing at reference points, calibrating, and the test itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tickfix.api import Floats, RadioMap, Rng, Survey
from tickfix.reproduction.wang2015.site import CALIBRATION, FLOOR, ROUTE, SPACING_M, draw_building, reference_points
from tickfix.simulation import (
    START_NS,
    Building,
    Hold,
    Logging,
    Phone,
    Receiver,
    SimulatedWalk,
    Walkable,
    Walker,
    draw_phone,
    draw_walker,
    route_through,
    simulate_stand,
    simulate_walk,
    walkable,
)
from tickfix.site.survey import survey
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
_BREAK_NS: Final = 120_000_000_000
_DAY_NS: Final = 86_400_000_000_000
_HOUR_NS: Final = 3_600_000_000_000


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Twin:
    """What one seed draws.

    Attributes:
        building: the site.
        radio_map: of a survey that stood still.
        calibration: three walks before the test.
        walk: the test.
    """

    building: Building
    radio_map: RadioMap
    calibration: tuple[SimulatedWalk, ...]
    walk: SimulatedWalk

    @property
    def survey(self) -> Survey:
        """What dead reckoning learns from."""
        walks = tuple(survey_walk(walk.recording, walk.recording.name) for walk in self.calibration)
        return Survey(floors=self.building.floors, radio_map=self.radio_map, walks=walks)


def draw_twin(seed: int) -> Twin:
    """Draw the building's fields, the person and the phone, and let them survey, calibrate and walk."""
    site_rng, person_rng, survey_rng, walk_rng = np.random.default_rng([seed, 2015]).spawn(4)
    building = draw_building(site_rng)
    walker, phone = _steady(draw_walker(person_rng)), _galaxy(draw_phone(person_rng))
    ground = walkable(building.floor(FLOOR))
    *calibration, test = [
        _walk(building, ground, places, rng, name, walker, phone, START_NS + _DAY_NS + n * _HOUR_NS)
        for n, (name, places, rng) in enumerate(
            zip(
                ("calibration-1", "calibration-2", "calibration-3", "test"),
                (*CALIBRATION, ROUTE),
                walk_rng.spawn(len(CALIBRATION) + 1),
                strict=True,
            )
        )
    ]
    radio_map = stand_at_points(building, reference_points(), survey_rng)
    return Twin(building=building, radio_map=radio_map, calibration=tuple(calibration), walk=test)


def stand_at_points(building: Building, points: Floats, rng: Rng) -> RadioMap:
    """Return the radio map of a surveyor who stands at each of ``points`` (P, 2), facing one direction after another.

    Args:
        building: where.
        points: (P, 2) metres.
        rng: draws fading and what is missed.
    """
    stands = [
        simulate_stand(
            building,
            FLOOR,
            (float(xy[0]), float(xy[1])),
            stand_rng,
            name=f"point-{point:02d}-{turn}",
            # A moment more than is needed, so that the last measurement ends in time.
            seconds=SCANS * FIX_S + 0.1,
            heading_rad=2.0 * np.pi * turn / DIRECTIONS,
            receiver=RECEIVER,
            start_ns=START_NS + (point * DIRECTIONS + turn) * _BREAK_NS,
        )
        for point, (xy, point_rng) in enumerate(zip(points, rng.spawn(len(points)), strict=True))
        for turn, stand_rng in enumerate(point_rng.spawn(DIRECTIONS))
    ]
    return survey(stands, building.floors, spacing_m=SPACING_M / 2.0, reach_m=0.0).site.radio_map


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
