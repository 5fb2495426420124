"""The twin of [jiang2015].

The room and its radio, people and phones, training walks and test walks. TWIN_SETTINGS lists what the text prints and
what was chosen before any result was seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tickfix.api import Floats, Floor, RadioMap, Recording, Rng, Survey, SurveyWalk, Truth
from tickfix.simulation import (
    START_NS,
    AccessPoint,
    Building,
    LoggingSettings,
    Phone,
    PhoneHold,
    Receiver,
    Route,
    SimulatedWalk,
    Trajectory,
    Walker,
    assemble_building,
    declare_floor,
    draw_phone,
    draw_receiver,
    draw_walker,
    round_corners,
    simulate_scans,
    simulate_walk,
    walkable_grid,
)
from tickfix.site import to_survey_walk
from tickfix_papers.reproduction_report import TwinSetting

_SETTING_ROWS: Final = (
    ("room", "8.5 m × 12 m, one room with four walls", "printed, section 8.1; no furniture is printed"),
    (
        "room in the floor's frame",
        "turned clockwise by 30°",
        "chosen: a plain angle jumps at due south, where the printed regression cannot work: no leg points there",
    ),
    ("participants, walks, phones", "4 people × 5 walks, each phone once by each person", "printed, section 8.1"),
    ("sampling rate", "65 Hz", "printed, section 8.1"),
    ("window and tick", "200 ms", "printed, section 8.2.1"),
    (
        "route",
        "60 m: aisles up, across and back, corners rounded with 1 m",
        "chosen: Fig. 9 is not in the text; its length gives about the 5316 training windows printed in 8.2.2",
    ),
    (
        "paces",
        "0.65, 0.85, 1, 1.3 and 1.8 times a person's own speed",
        "printed in words, section 8.1: slow, middle, fast and even run; the numbers are chosen",
    ),
    ("people, phones, magnetic field", "drawn by the simulator with its defaults, no pauses", "chosen"),
    (
        "hold of the phone",
        "drawn for each walk: σ 3° in yaw, 4° in pitch, 2° in roll",
        "chosen: people hold a phone differently",
    ),
    ("label points", "every 2 m along the route, tapped with σ 0.1 s", "chosen; labels by volume key are printed"),
    ("labels", "cubic splines through the label points", "printed, section 4"),
    (
        "fingerprint points",
        "36, a grid of 1.5 m × 2 m",
        "printed, section 8.1: 36 points 1.5 to 2 m apart; grid chosen",
    ),
    (
        "fingerprints",
        "4 registrations a point, each the mean of 3 scans",
        "printed, section 8.1; that they face four ways, all with one phone, is chosen",
    ),
    (
        "access points",
        "12, two of them in the room, the others up to 18 m away behind one wall; the 10 most frequent are used",
        "chosen: the text has none; “several most frequent” is printed",
    ),
    ("radio", "the simulator's defaults", "chosen"),
    ("scans", "one about every 2 s", "printed, sections 2 and 7 (Fig. 17 says 4.5 s); 1.2 to 2 s long, chosen"),
    ("missing access points", "−95 dBm", "printed, section 7"),
    ("K of Wi-Fi", "4 for both methods", "chosen: the corners of a cell of the grid"),
    ("hidden nodes", "500 hardlim, 1000 sigmoid", "printed, section 8.2.2; the Wi-Fi classifier has 500, chosen"),
    (
        "hidden nodes of Table 3",
        "the best of 50, 100, 200, 350, 500 and of 100, 200, 400, 700, 1000 for each window",
        "chosen: the numbers of 8.2.2 were found for 200 ms, and there are too few windows of 1 s for them",
    ),
    (
        "particle filter",
        "Q 0.1 m² a tick, σ 0.5 m",
        "printed, section 6, as read in the preset of fusion-pf; N = 500 chosen",
    ),
    (
        "Kalman filters",
        "constant velocity, accelerations of σ 0.5 m/s²; positions of σ 0.5 m by dead reckoning, 1.5 m by Wi-Fi",
        "chosen: no model is printed",
    ),
    ("gait", "0.7 m a step, the plugin's defaults", "chosen: “a default step length” is printed"),
    (
        "tests",
        "each of the 4 people walks the route once at their own pace, with the phone of the fingerprints",
        "printed in words, section 8.1: a user with a phone, along the same route; how many is chosen",
    ),
    ("start", "given, with σ 0.1 m, to all that use motion", "printed, section 5: the start must be given"),
    (
        "errors, Table 4 and Fig. 16",
        "every published estimate against the true place at its tick",
        "chosen: the text says mean error",
    ),
    (
        "errors, Fig. 14",
        "the method's estimate after each location result, against the true position at that tick",
        "chosen; the time by which a phone delivers results late does not count as an error",
    ),
)

TWIN_SETTINGS: Final = tuple(
    TwinSetting(what=what, value=value, source=source) for what, value, source in _SETTING_ROWS
)


FLOOR: Final = "F8"
_WIDTH_M, _LENGTH_M = 8.5, 12.0
_TURNED_RAD: Final = np.radians(30.0)
_CORNERS: Final = np.array(
    [
        [7.5, 0.9],
        [7.5, 11.2],
        [0.95, 11.2],
        [0.95, 8.2],
        [7.5, 8.2],
        [7.5, 4.8],
        [0.95, 4.8],
        [0.95, 0.9],
        [7.5, 0.9],
        [7.5, 11.2],
        [0.95, 11.2],
    ]
)
_RADIUS_M: Final = 1.0
_POINTS_X, _POINTS_Y = np.arange(0.5, 8.5, 1.5), np.arange(1.0, 12.0, 2.0)
_RADIO_X, _RADIO_Y = (-9.0, 1.5, 7.0, 17.5), (-8.0, 6.0, 20.0)
_CHANNELS: Final = (0.02, 0.4, 0.98)


def floor_plan() -> Floor:
    """Return the floor: one room with four walls."""
    corners = np.array([[0.0, 0.0], [_WIDTH_M, 0.0], [_WIDTH_M, _LENGTH_M], [0.0, _LENGTH_M]])
    return declare_floor(FLOOR, _room_to_floor(corners))


def route() -> Route:
    """Return the fixed route: straights through the aisles and curves between them, never due south for long."""
    return Route(FLOOR, round_corners(walkable_grid(floor_plan()), _room_to_floor(_CORNERS), _RADIUS_M))


def fingerprint_points() -> Floats:
    """Return the 36 points (36, 2), metres."""
    x, y = np.meshgrid(_POINTS_X, _POINTS_Y)
    return _room_to_floor(np.column_stack([x.ravel(), y.ravel()]))


def draw_building(rng: Rng) -> Building:
    """Return the room with twelve access points around and in it; shadowing and magnetic disturbance are drawn."""
    places = [(x, y) for y in _RADIO_Y for x in _RADIO_X]
    points = [
        AccessPoint(
            name=f"02:00:00:00:08:{i:02x}",
            floor=FLOOR,
            xy=(float(xy[0]), float(xy[1])),
            channel=_CHANNELS[i % len(_CHANNELS)],
        )
        for i, xy in enumerate(_room_to_floor(np.array(places)))
    ]
    return assemble_building([floor_plan()], points, rng)


def _room_to_floor(xy: Floats) -> Floats:
    """Return places (n, 2) of the room in the floor's frame: turned clockwise, the drawing's corner at the origin."""
    sin, cos = np.sin(_TURNED_RAD), np.cos(_TURNED_RAD)
    turned: Floats = xy @ np.array([[cos, -sin], [sin, cos]]) + np.array([0.0, _WIDTH_M * sin])
    return turned


PEOPLE: Final = 4
PHONES: Final = 5
PACES: Final = (0.65, 0.85, 1.0, 1.3, 1.8)
"""Slow, middle, fast and running, as multiples of a person's preferred speed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Handset:
    """A phone: its motion sensors and its Wi-Fi."""

    phone: Phone
    receiver: Receiver


def draw_people(rng: Rng) -> tuple[Walker, ...]:
    """Draw the four participants, who walk without stopping."""
    return tuple(replace(draw_walker(rng), pauses_per_m=0.0) for _ in range(PEOPLE))


def draw_handsets(rng: Rng) -> tuple[Handset, ...]:
    """Draw the five phones; all sample at 65 Hz and scan about every two seconds."""
    return tuple(
        Handset(
            phone=replace(draw_phone(rng), rate_hz=65.0),
            receiver=replace(draw_receiver(rng), scan_s=(1.2, 2.0), pause_s=(0.2, 0.6), delivery_s=(0.1, 0.6)),
        )
        for _ in range(PHONES)
    )


def walker_at_pace(person: Walker, pace: float, rng: Rng) -> Walker:
    """Return a person at a pace, with a hold of the phone drawn for this walk."""
    yaw, pitch, roll = np.radians([3.0, 4.0, 2.0]) * rng.standard_normal(3)
    hold: PhoneHold = replace(
        person.hold,
        yaw_rad=person.hold.yaw_rad + float(yaw),
        pitch_rad=person.hold.pitch_rad + float(pitch),
        roll_rad=person.hold.roll_rad + float(roll),
    )
    return replace(person, speed_mps=pace * person.speed_mps, hold=hold)


REGISTRATIONS: Final = 4
SCANS: Final = 3
_LABEL_M: Final = 2.0
_TAP_S: Final = 0.1
_STATIONARY_S: Final = 12.0
_HOUR_NS: Final = 3_600_000_000_000


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Twin:
    """One draw of the experiment.

    Attributes:
        floor: the room.
        training_data: radio map of 36 points and 20 labelled walks.
        walks: one of each person, with the phone that surveyed the Wi-Fi, later.
    """

    floor: Floor
    training_data: Survey
    walks: tuple[SimulatedWalk, ...]


def draw_twin(seed: int) -> Twin:
    """Draw the room's radio, the people and their phones, and let them walk; the same seed gives the same bytes."""
    site_rng, who_rng, radio_rng, train_rng, test_rng = np.random.default_rng([2015, seed]).spawn(5)
    site = draw_building(site_rng)
    people, handsets = draw_people(who_rng), draw_handsets(who_rng)
    way = route()
    training_data = []
    for p, person in enumerate(people):
        for n, pace in enumerate(PACES):
            rng, name = train_rng.spawn(1)[0], f"train-{p}-{n}"
            walk = simulate_walk(
                site,
                way,
                rng,
                name=name,
                walker=walker_at_pace(person, pace, rng),
                phone=handsets[(p + n) % len(handsets)].phone,
                receiver=handsets[(p + n) % len(handsets)].receiver,
                logging=LoggingSettings(waypoint_m=_LABEL_M),
                start_ns=START_NS + (p * len(PACES) + n) * _HOUR_NS,
            )
            training_data.append(_training_walk(walk.recording, rng))
    walks = []
    for p, person in enumerate(people):
        rng = test_rng.spawn(1)[0]
        walks.append(
            simulate_walk(
                site,
                way,
                rng,
                name=f"test-{p}",
                walker=walker_at_pace(person, 1.0, rng),
                phone=handsets[0].phone,
                receiver=handsets[0].receiver,
                start_ns=START_NS + (100 + p) * _HOUR_NS,
            )
        )
    radio_map = _radio_map(site, handsets[0], radio_rng)
    survey = Survey(floors=site.floors, radio_map=radio_map, walks=tuple(training_data))
    return Twin(floor=site.floors[0], training_data=survey, walks=tuple(walks))


def _training_walk(recording: Recording, rng: Rng) -> SurveyWalk:
    """Return a walk as the regression learns from it: with labels at the volume key's times, without Wi-Fi."""
    walk = to_survey_walk(recording, recording.name)
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
            stationary = _stationary_trajectory(xy, np.pi / 2.0 * registration)
            heard = simulate_scans(stationary, site.floors[0], site.radio, handset.receiver, rng.spawn(1)[0])[:SCANS]
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


def _stationary_trajectory(xy: Floats, heading_rad: float) -> Trajectory:
    """Return the trajectory of a person who stands at (2,), metres, for the longest time three scans can take."""
    t_s = np.array([0.0, _STATIONARY_S])
    still = np.zeros(2)
    return Trajectory(
        t_s=t_s,
        distance_m=still,
        xy=np.array([xy, xy]),
        heading_rad=np.full(2, heading_rad),
        speed_mps=still,
        phase=still,
        swing_mps2=still,
    )
