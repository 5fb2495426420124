"""The twin of [wang2015] section 6.1.

Corridors, a hall, 60 access points in a row; the survey, calibration walks and the test walk. The text prints no
dimension and no coordinate: TWIN_SETTINGS lists what was chosen, before any result was seen. One thing was
changed afterwards: a single sigma of fixes is calibrated, so that fixes keep the time of their epochs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tickfix.api import Floats, Floor, RadioMap, Rng, Survey, frozen
from tickfix.simulation import (
    START_NS,
    AccessPoint,
    Building,
    LoggingSettings,
    Magnetism,
    Phone,
    PhoneHold,
    Receiver,
    SimulatedWalk,
    WalkableGrid,
    Walker,
    assemble_building,
    declare_floor,
    draw_phone,
    draw_walker,
    rectangle,
    route_through,
    simulate_stationary_scans,
    simulate_walk,
    walkable_grid,
    wall,
)
from tickfix.site import survey_recordings, to_survey_walk
from tickfix_papers.reproduction_report import TwinSetting

FLOOR: Final = "F4"
SPACING_M: Final = 3.0
"""Of the reference points: one line of them in a corridor, a lattice in the hall."""
POWER_DBM: Final = -65.0
"""At 1 m; with it about ten of the access points are heard at a reference point, as Figure 14(b) shows."""
_CORRIDOR_M: Final = 2.4
_WEST, _EAST, _SOUTH, _NORTH = 1.2, 58.2, 8.2, 23.2
"""Middles of the four corridors, metres."""
_HALL: Final = (23.7, 32.7)
"""Its walls in the west and in the east; it reaches from corridor to corridor."""
_WIDTH_M, _HEIGHT_M = 59.4, 31.4
_ROOM_M: Final = 6.0

ROUTE: Final = ((_WEST, _SOUTH), (28.2, _SOUTH), (28.2, _NORTH), (_EAST, _NORTH), (_EAST, _SOUTH), (_WEST, _SOUTH))
"""The test walk: along the south, through the hall, round the eastern half and back along the whole south, 144 m."""
CALIBRATION: Final = (
    ((_WEST, _SOUTH), (_WEST, _NORTH), (_EAST, _NORTH)),
    ((_EAST, _NORTH), (_EAST, _SOUTH), (_WEST, _SOUTH)),
    ((_WEST, _SOUTH), (25.2, _SOUTH), (31.2, _NORTH), (_WEST, _NORTH), (_WEST, _SOUTH)),
)
"""Walks by which K of eq. (7), the drawing's north and the noise of fixes are calibrated."""


def floor_plan() -> Floor:
    """Return the floor: only corridors and hall are free, the rooms between them are obstacles with walls within."""
    half = _CORRIDOR_M / 2.0
    south, north = _SOUTH - half, _NORTH + half
    rooms = (
        (0.0, 0.0, _WIDTH_M, south),
        (0.0, north, _WIDTH_M, _HEIGHT_M),
        (_WEST + half, _SOUTH + half, _HALL[0], _NORTH - half),
        (_HALL[1], _SOUTH + half, _EAST - half, _NORTH - half),
    )
    walls = [
        wall((float(x), y0), (float(x), y1))
        for x0, y0, x1, y1 in rooms
        for x in np.arange(x0 + _ROOM_M, x1 - 1.0, _ROOM_M)
    ]
    middle = (_SOUTH + _NORTH) / 2.0
    walls += [wall((x0, middle), (x1, middle)) for x0, _, x1, _ in rooms[2:]]
    return declare_floor(
        FLOOR, rectangle(0.0, 0.0, _WIDTH_M, _HEIGHT_M), walls, [rectangle(*room) for room in rooms], level=4
    )


def reference_points() -> Floats:
    """Return the reference points (60, 2): every 3 m in the corridors, 3 m × 3 m in the hall."""
    along = _WEST + SPACING_M * np.arange(20)
    across = _SOUTH + SPACING_M * np.arange(1, 5)
    columns = [_WEST, *along[(along > _HALL[0]) & (along < _HALL[1])].tolist(), _EAST]
    points = [(x, y) for y in (_SOUTH, _NORTH) for x in along] + [(x, y) for x in columns for y in across]
    return frozen(np.array(points, np.float64))


def access_points() -> tuple[AccessPoint, ...]:
    """Return 60 access points, evenly along the middles of corridors and hall."""
    middle = (_HALL[0] + _HALL[1]) / 2.0
    rows = (
        ((_WEST, _SOUTH), (_EAST, _SOUTH), 22),
        ((_WEST, _NORTH), (_EAST, _NORTH), 22),
        ((_WEST, _SOUTH), (_WEST, _NORTH), 5),
        ((_EAST, _SOUTH), (_EAST, _NORTH), 5),
        ((middle, _SOUTH), (middle, _NORTH), 6),
    )
    places = [np.array(a) + (i + 0.5) / n * (np.array(b) - np.array(a)) for a, b, n in rows for i in range(n)]
    return tuple(
        AccessPoint(
            name=f"02:00:00:00:04:{i:02x}",
            floor=FLOOR,
            xy=(float(x), float(y)),
            power_dbm=POWER_DBM,
            channel=(0.05, 0.5, 0.95)[i % 3],
        )
        for i, (x, y) in enumerate(places)
    )


def draw_building(rng: Rng) -> Building:
    """Return the building; its shadowing and its magnetic field are drawn."""
    return assemble_building([floor_plan()], access_points(), rng, magnetism=Magnetism(north_rad=0.2))


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
    """The twin of one seed.

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
        walks = tuple(to_survey_walk(walk.recording, walk.recording.name) for walk in self.calibration)
        return Survey(floors=self.building.floors, radio_map=self.radio_map, walks=walks)


def draw_twin(seed: int) -> Twin:
    """Draw the building's fields, the person and the phone, and let them survey, calibrate and walk."""
    site_rng, person_rng, survey_rng, walk_rng = np.random.default_rng([seed, 2015]).spawn(4)
    building = draw_building(site_rng)
    walker, phone = _steady_walker(draw_walker(person_rng)), _galaxy_s4(draw_phone(person_rng))
    walkable_area = walkable_grid(building.floor(FLOOR))
    *calibration, test = [
        _simulate_walk(building, walkable_area, places, rng, name, walker, phone, START_NS + _DAY_NS + n * _HOUR_NS)
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
        simulate_stationary_scans(
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
    return survey_recordings(stands, building.floors, spacing_m=SPACING_M / 2.0, reach_m=0.0).site.radio_map


def _simulate_walk(
    building: Building,
    walkable_area: WalkableGrid,
    places: Sequence[tuple[float, float]],
    rng: Rng,
    name: str,
    walker: Walker,
    phone: Phone,
    start_ns: int,
) -> SimulatedWalk:
    return simulate_walk(
        building,
        route_through(walkable_area, np.array(places)),
        rng,
        name=name,
        walker=walker,
        phone=phone,
        receiver=RECEIVER,
        logging=LoggingSettings(waypoint_m=3.0),
        start_ns=start_ns,
    )


def _steady_walker(walker: Walker) -> Walker:
    """Return the walker with "a uniform and stable gait", who holds the phone "as stable as possible"."""
    hold = PhoneHold(pitch_rad=walker.hold.pitch_rad, sway_rad=0.02, wander_rad=0.01)
    return replace(walker, pauses_per_m=0.0, hold=hold)


def _galaxy_s4(phone: Phone) -> Phone:
    """Return the phone with the noise that Table 3 prints for the Galaxy S4."""
    return replace(phone, accelerometer_noise_mps2=0.0006, gyroscope_noise_rad_s=0.0003, magnetometer_noise_ut=0.06)


_SETTING_ROWS: Final = (
    (
        "where one can walk",
        "corridors and a hall (a linear and a non-linear part), no room",
        "printed: section 6.1, Figure 13",
    ),
    (
        "dimensions",
        (
            "59.4 m × 31.4 m; two corridors of 59.4 m, 15 m apart, joined at both ends and by a hall of 9 m × 12.6 m; "
            "corridors 2.4 m wide; rooms with a wall every 6 m between them"
        ),
        "chosen: not printed",
    ),
    ("access points", "60, evenly along corridors and hall, on the ceiling", "printed: section 6.1, Figure 14(a)"),
    (
        "their power",
        f"{POWER_DBM:g} dBm at 1 m: on average ten are heard in a scan at a reference point",
        "chosen to meet Figure 14(b), which shows ten available ones",
    ),
    ("propagation and magnetic field", "the simulator's defaults, drawn by each seed", "chosen: not printed"),
    (
        "reference points",
        f"60, every {SPACING_M:g} m: a line in corridors, a lattice in the hall",
        "chosen: section 2 prints equally spaced lattices, no spacing",
    ),
    (
        "survey",
        f"standing at each point, {DIRECTIONS} directions, {SCANS} measurements in each",
        "chosen: section 2 prints v measurements, no v",
    ),
    (
        "RSSI measurements",
        "one scan every 2 s, instantaneous and delivered immediately",
        "printed: section 3.3; its delay is not",
    ),
    ("phone", "50 Hz; noise of its sensors as in Table 3, biases drawn", "printed: Table 3; the rest chosen"),
    (
        "person",
        "drawn by each seed; uniform gait without a pause, the phone held as stable as possible",
        "printed: section 6.1; pace and step length are not",
    ),
    (
        "route",
        "143 m, about 112 s: south corridor, hall, north, east, and back along the south",
        "chosen: Figure 15 cannot be read from the text; Figure 16 ends at about 120 s",
    ),
    (
        "calibration",
        "K, the drawing's north and σ of Wi-Fi positions from three walks of the same person before the test",
        "K: printed, section 3.1; walks and σ chosen",
    ),
    (
        "start",
        "PDR: the true place, as its error begins at zero in Figure 16; all others: their first Wi-Fi position",
        "chosen: not printed",
    ),
    (
        "parameters",
        (
            "presets wang2015 of topology-knn, pseudo-odometry, fading-ekf and map-pf; what these do not print is "
            "tickfix's default"
        ),
        "printed: δS = 3 m, δ(Δt_p) = 0.2 s, σ = 1 m, 100 particles; chosen: the rest",
    ),
    (
        "where errors are taken",
        (
            "at the epochs of the Wi-Fi positions, every 2 s from the second on: for all schemes the estimate "
            "published then, against the true place then"
        ),
        "chosen: residuals are printed by epoch (Tables 6 and 8)",
    ),
    (
        "gross errors on Wi-Fi",
        (
            "10 m east at 40 s and 60 s, 10 m north at 80 s, added to the position found; on this route the "
            "first lies along a corridor, the others across one"
        ),
        "printed: Table 5; the route is chosen",
    ),
    (
        "gross errors on P-O",
        "10 m added to the increment read at 40 s, 60 s and 80 s, along its heading",
        "printed: Table 7",
    ),
    (
        "particle filter without map",
        "the same filter without a map, observing the same EKF",
        "chosen: section 5.1 does not say what the filter of Table 1 observed",
    ),
)

TWIN_SETTINGS: Final = tuple(
    TwinSetting(what=what, value=value, source=source) for what, value, source in _SETTING_ROWS
)
