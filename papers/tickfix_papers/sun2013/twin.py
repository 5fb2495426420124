"""The twin of [sun2013] section 4.1.

Plan, access points, reference and test points, survey and test samples. Metres, x across the 24.9 m, y along the 66.4
m. TWIN_SETTINGS lists what is printed and what was chosen before the first run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image, ImageDraw

from tickfix.api import Floats, Floor, Recording, Rng, Scan
from tickfix.simulation import (
    START_NS,
    AccessPoint,
    Propagation,
    Receiver,
    assemble_building,
    declare_floor,
    rectangle,
    simulate_stationary_scans,
    wall,
)
from tickfix_papers.reproduction_report import TwinSetting

SURVEY_S: Final = 150.0
TEST_S: Final = 50.0
TEST_SAMPLES: Final = 100
"""All 6500 over 65 test points."""
ONLINE_SAMPLES: Final = 2
PASSES: Final = TEST_SAMPLES // ONLINE_SAMPLES
POINTS_AVERAGED: Final = 7
STEP_S: Final = 1.0

SURFACE_N: Final = (1, 2, 3, 5, 8, 12, 16, 20)
SURFACE_K: Final = (1, 2, 3, 5, 7, 10, 14, 20)
SURFACE_STARTS: Final = (0, 27, 54, 80)
"""Where in the samples of a test point the N samples begin."""
COMPARED_PASSES: Final = 10
"""Passes on which variants of a fingerprint are compared."""
PLAIN_POINTS: Final = 13
"""Every fifth test point of the first pass: the plain NCC takes its time."""

LITTLE_PERCENT: Final = (0.0, 15.0)
ABOUT_30_PERCENT: Final = (20.0, 40.0)
ALIKE_PERCENT: Final = 10.0

PROPAGATION: Final = Propagation()
RECEIVER: Final = Receiver(scan_s=(0.5, 0.5), pause_s=(0.0, 0.0), delivery_s=(0.0, 0.0), stale_s=0.0)

_SETUP_SOURCE: Final = "[sun2013] section 4.1"
_METHOD_SOURCE: Final = "[sun2013] section 4.2.1"

TWIN_SETTINGS: Final = (
    TwinSetting(what="floor", value="24.9 m × 66.4 m; experiment in 24.9 m × 28.0 m of it", source=_SETUP_SOURCE),
    TwinSetting(
        what="plan",
        value="ring of 3 m corridors around a solid core of 4.5 m, rooms 7.2 m deep outside; Room 1211 7.2 m × 10.5 m, "
        "door 1 m; other doors shut",
        source="corridor width [sun2013] 4.1, corners 4.2.1; the rest chosen: figure 3 is not in the text",
    ),
    TwinSetting(
        what="access points",
        value="9, of which 4 in the experimental area; −38 dBm at 1 m",
        source=f"numbers {_SETUP_SOURCE}; places chosen, spread over rooms and corridors; power: simulator's default",
    ),
    TwinSetting(
        what="reference points",
        value="91, 1.5 m apart: 35 in the room, 56 in two rows along the corridors",
        source=f"number {_SETUP_SOURCE}; chosen: the lattice that fills room and corridors with 91",
    ),
    TwinSetting(what="survey", value="300 samples at each reference point in 150 s", source=_SETUP_SOURCE),
    TwinSetting(
        what="test",
        value="65 points 0.6 m apart from A in the room to B in the corridor, 100 samples each",
        source=_SETUP_SOURCE,
    ),
    TwinSetting(
        what="trajectory",
        value="room, door, western corridor, two corners, eastern corridor; in the middle of aisles and corridors",
        source="chosen: A, B, the gaps and their number are printed, the route is not",
    ),
    TwinSetting(
        what="passes",
        value="50 walks at 0.6 m/s: pass i has samples 2i and 2i + 1 of every point, a result each second",
        source="[sun2013] 4.2.1 for one pass; chosen: that all 6500 samples make 50 of them",
    ),
    TwinSetting(
        what="rate", value="2 samples a second, whole dBm", source=f"{_SETUP_SOURCE}; NetStumbler reads whole dBm"
    ),
    TwinSetting(
        what="receiver",
        value="one laptop for survey and test; hears down to −95 dBm, misses 12 % of beacons",
        source=f"one laptop {_SETUP_SOURCE}; the rest: the simulator's defaults",
    ),
    TwinSetting(
        what="propagation",
        value="exponent 2.2, 3.5 dB a wall, shadowing 4 dB over 5 m, body 4 dB, drift 1 dB between stands, fading 2 dB "
        "over 6 s, 1.5 dB from sample to sample",
        source="chosen: the simulator's defaults",
    ),
    TwinSetting(
        what="body",
        value="survey: random orientation for each reference point; test: along the trajectory",
        source="chosen",
    ),
    TwinSetting(what="N, K", value="2, 7", source=_METHOD_SOURCE),
    TwinSetting(
        what="KNN, WKNN",
        value="Euclidean distance in dB between mean samples; WKNN: inverse distance; −100 dBm for missing",
        source=f"{_METHOD_SOURCE}; weights and missing value are not printed",
    ),
    TwinSetting(
        what="RSS_l of eq. (1)",
        value="blocks of N survey samples, the best coefficient of a point's blocks",
        source="chosen: how the matrices are created is not printed; other readings stand in a table of their own",
    ),
    TwinSetting(
        what="sign", value="eqs. (5)–(6) keep the sign of the numerator", source="needed for the order of eq. (1)"
    ),
    TwinSetting(
        what="map image", value="pixels of 0.1 m, walls 0.2 m thick, T_threshold 0.55", source="threshold 4.3.1; chosen"
    ),
    TwinSetting(
        what="calibration model",
        value="the middles of the corridors in the experimental area, three aisles of the room",
        source="straight lines that represent walkways: section 3.2; chosen: where they lie",
    ),
    TwinSetting(
        what="map alone",
        value="S_(n−1) is the point before as corrected; a first point in structure goes to the nearest walkway",
        source="chosen: figure 1 is not in the text",
    ),
    TwinSetting(
        what="Kalman filter",
        value="ΔT 1 s; a_x, a_y of σ 0.05 m/s²; R = 6 m² on the diagonal; first speed 0 with σ 1 m/s",
        source="[sun2013] 4.3.2; first speed chosen: the plugin's default",
    ),
    TwinSetting(
        what="surfaces",
        value=f"N in {SURFACE_N}, K in {SURFACE_K}, {len(SURFACE_STARTS)} queries a test point",
        source="1 to 20 each in figure 4; chosen: eight values",
    ),
    TwinSetting(
        what="variants",
        value=f"readings of eq. (1), literal eq. (6): {COMPARED_PASSES} passes; plain NCC: {PLAIN_POINTS} queries",
        source="chosen: to limit the computing time",
    ),
    TwinSetting(
        what="“little”, “about 30 %”, “whatever the fingerprint”",
        value="a reduction of the mean error between 0 and 15 %; between 20 and 40 %; three reductions that differ by "
        "less than 10 points",
        source="chosen; the paper has 3–8 %, 28–32 %, and 4 points",
    ),
)


FLOOR: Final = "F12"
WIDTH_M: Final = 24.9
LENGTH_M: Final = 66.4
WEST: Final = (7.2, 10.2)
EAST: Final = (14.7, 17.7)
SOUTH: Final = (7.0, 10.0)
NORTH: Final = (56.4, 59.4)
ROOM: Final = (16.0, 26.5)
DOOR_Y: Final = 18.0
SPACING_M: Final = 1.5
GAP_M: Final = 0.6
TEST_POINTS: Final = 65
PIXEL_M: Final = 0.1

TRAJECTORY: Final = ((3.6, 24.0), (3.6, DOOR_Y), (8.7, DOOR_Y), (8.7, 8.5), (16.2, 8.5), (16.2, 18.8))
"""Corners of the trajectory from A to B."""

WALKWAYS: Final = (
    ((3.6, 17.0), (3.6, 25.5)),
    ((1.0, DOOR_Y), (8.7, DOOR_Y)),
    ((1.0, 24.0), (6.2, 24.0)),
    ((8.7, 8.5), (8.7, 28.0)),
    ((8.7, 8.5), (16.2, 8.5)),
    ((16.2, 8.5), (16.2, 28.0)),
)
"""The calibration model: the middles of the corridors, and the aisles of the room."""

_ACCESS_POINTS: Final = (
    *((3.6, 3.5), (21.3, 12.0), (3.6, 25.0), (16.2, 25.0)),
    *((8.7, 36.0), (21.3, 41.0), (3.6, 47.0), (16.2, 52.0), (12.45, 62.9)),
)


def floor_plan() -> Floor:
    """Return the plan; of the rooms only 1211 has an open door."""
    west = [wall((0, y), (WEST[0], y)) for y in (*ROOM, 36.5, 46.5)]
    east = [wall((EAST[1], y), (WIDTH_M, y)) for y in (17.0, 27.0, 37.0, 47.0)]
    ends = [wall((0, y), (WIDTH_M, y)) for y in (SOUTH[0], NORTH[1])]
    rooms = [wall((x, a), (x, b)) for x in (8.3, 16.6) for a, b in ((0.0, SOUTH[0]), (NORTH[1], LENGTH_M))]
    corridors = [
        wall((WEST[0], SOUTH[0]), (WEST[0], NORTH[1]), [DOOR_Y - SOUTH[0]]),
        wall((EAST[1], SOUTH[0]), (EAST[1], NORTH[1])),
    ]
    core = rectangle(WEST[1], SOUTH[1], EAST[0], NORTH[0])
    walls = [*west, *east, *ends, *rooms, *corridors]
    return declare_floor(FLOOR, rectangle(0, 0, WIDTH_M, LENGTH_M), walls, [core], level=12)


def access_points() -> tuple[AccessPoint, ...]:
    """Return the nine access points, four of them in the experimental area."""
    return tuple(
        AccessPoint(name=f"02:00:00:00:00:{i:02x}", floor=FLOOR, xy=xy) for i, xy in enumerate(_ACCESS_POINTS, start=1)
    )


def reference_points() -> Floats:
    """Return the reference points (91, 2): two rows along the corridors, a lattice in the room."""
    south, room = SOUTH[0] + SPACING_M / 2, ROOM[0] + SPACING_M / 2
    western, southern, eastern = ((7.95, south), 2, 13), ((10.95, south), 3, 2), ((15.45, south), 2, 12)
    return np.concatenate([_lattice(*part) for part in (western, southern, eastern, ((0.6, room), 5, 7))])


def test_points() -> tuple[Floats, Floats]:
    """Return the test points (65, 2) from A to B, and which way one walks at each (65,), radians from +y."""
    corners = np.array(TRAJECTORY)
    legs = np.diff(corners, axis=0)
    way_m = np.concatenate([[0.0], np.cumsum(np.hypot(*legs.T))])
    at = GAP_M * np.arange(TEST_POINTS)
    xy = np.stack([np.interp(at, way_m, corners[:, i]) for i in range(2)], axis=1)
    leg = np.minimum(np.searchsorted(way_m, at, side="right") - 1, len(legs) - 1)
    return xy, np.arctan2(legs[leg, 0], legs[leg, 1])


def draw_plans(folder: Path) -> tuple[Path, Path]:
    """Write the plan without and with walkways as grey-scale images, structure and walkways dark: eq. (7)."""
    plan = floor_plan()
    size = (round(WIDTH_M / PIXEL_M), round(LENGTH_M / PIXEL_M))
    image = Image.new("L", size, 255)
    draw = ImageDraw.Draw(image)
    for ring in plan.obstacles:
        draw.polygon(_pixels(ring, size[1]), fill=0)
    for segment in plan.walls:
        draw.line(_pixels(segment, size[1]), fill=0, width=2)
    paths = folder / "plan.png", folder / "plan-with-walkways.png"
    image.save(paths[0])
    for line in WALKWAYS:
        draw.line(_pixels(np.array(line), size[1]), fill=60, width=1)
    image.save(paths[1])
    return paths


def _lattice(corner: tuple[float, float], columns: int, rows: int) -> Floats:
    """Return the points (n, 2) of a lattice by its south-western corner."""
    row, column = np.indices((rows, columns)).reshape(2, -1)
    lattice: Floats = np.array(corner) + SPACING_M * np.stack([column, row], axis=1)
    return lattice


def _pixels(xy: Floats, rows: int) -> list[tuple[float, float]]:
    return [(float(x) / PIXEL_M, rows - 1 - float(y) / PIXEL_M) for x, y in xy]


_BREAK_NS = 120_000_000_000
_DAY_NS = 86_400_000_000_000


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Twin:
    """The results of one seed.

    Attributes:
        survey: a recording per reference point.
        samples: for each of the T test points its samples, as scans of half a second.
        xy: (T, 2) the test points.
    """

    survey: tuple[Recording, ...]
    samples: tuple[tuple[Scan, ...], ...]
    xy: Floats


def draw_twin(seed: int) -> Twin:
    """Draw the radio of the floor, survey it, and collect the test samples a day later."""
    radio_rng, heading_rng, survey_rng, test_rng = np.random.default_rng([seed, 2013]).spawn(4)
    building = assemble_building([floor_plan()], access_points(), radio_rng, propagation=PROPAGATION)
    points = reference_points()
    survey_headings = heading_rng.uniform(-np.pi, np.pi, len(points))

    def stands(
        places: Floats, headings: Floats, seconds: float, start_ns: int, rng: Rng, label: str
    ) -> Sequence[Recording]:
        return [
            simulate_stationary_scans(
                building,
                FLOOR,
                (float(xy[0]), float(xy[1])),
                mine,
                name=f"{label}-{n:02d}",
                # A sample more than is needed is begun, so that the last one needed ends in time.
                seconds=seconds + 0.25,
                heading_rad=float(heading),
                receiver=RECEIVER,
                start_ns=start_ns + n * (round(seconds * 1e9) + _BREAK_NS),
            )
            for n, (xy, heading, mine) in enumerate(zip(places, headings, rng.spawn(len(places)), strict=True))
        ]

    xy, headings = test_points()
    tested = stands(xy, headings, TEST_S, START_NS + _DAY_NS, test_rng, "test")
    return Twin(
        survey=tuple(stands(points, survey_headings, SURVEY_S, START_NS, survey_rng, "point")),
        samples=tuple(tuple(event for event in stand.events if isinstance(event, Scan)) for stand in tested),
        xy=xy,
    )
