"""What the twin of [sun2013] takes from the text, and what had to be chosen: fixed before the experiment first ran."""

from __future__ import annotations

from typing import Final

from tickfix.reproduction.report import Choice
from tickfix.simulation import Propagation, Receiver

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

_SETUP: Final = "[sun2013] section 4.1"
_METHOD: Final = "[sun2013] section 4.2.1"

CHOICES: Final = (
    Choice(what="floor", value="24.9 m × 66.4 m; experiment in 24.9 m × 28.0 m of it", source=_SETUP),
    Choice(
        what="plan",
        value="ring of 3 m corridors around a solid core of 4.5 m, rooms 7.2 m deep outside; Room 1211 7.2 m × 10.5 m, "
        "door 1 m; other doors shut",
        source="corridor width [sun2013] 4.1, corners 4.2.1; the rest chosen: figure 3 is not in the text",
    ),
    Choice(
        what="access points",
        value="9, of which 4 in the experimental area; −38 dBm at 1 m",
        source=f"numbers {_SETUP}; places chosen, spread over rooms and corridors; power: the simulator's default",
    ),
    Choice(
        what="reference points",
        value="91, 1.5 m apart: 35 in the room, 56 in two rows along the corridors",
        source=f"number {_SETUP}; chosen: the lattice that fills room and corridors with 91",
    ),
    Choice(what="survey", value="300 samples at each reference point in 150 s", source=_SETUP),
    Choice(
        what="test",
        value="65 points 0.6 m apart from A in the room to B in the corridor, 100 samples each",
        source=_SETUP,
    ),
    Choice(
        what="trajectory",
        value="room, door, western corridor, two corners, eastern corridor; in the middle of aisles and corridors",
        source="chosen: A, B, the gaps and their number are printed, the way is not",
    ),
    Choice(
        what="passes",
        value="50 walks at 0.6 m/s: pass i has samples 2i and 2i + 1 of every point, a result each second",
        source="[sun2013] 4.2.1 for one pass; chosen: that all 6500 samples make 50 of them",
    ),
    Choice(what="rate", value="2 samples a second, whole dBm", source=f"{_SETUP}; NetStumbler reads whole dBm"),
    Choice(
        what="receiver",
        value="one laptop for survey and test; hears down to −95 dBm, misses 12 % of beacons",
        source=f"one laptop {_SETUP}; the rest: the simulator's defaults",
    ),
    Choice(
        what="propagation",
        value="exponent 2.2, 3.5 dB a wall, shadowing 4 dB over 5 m, body 4 dB, drift 1 dB between stands, fading 2 dB "
        "over 6 s, 1.5 dB from sample to sample",
        source="chosen: the simulator's defaults",
    ),
    Choice(
        what="body",
        value="survey: looking anywhere, drawn for each reference point; test: along the trajectory",
        source="chosen",
    ),
    Choice(what="N, K", value="2, 7", source=_METHOD),
    Choice(
        what="KNN, WKNN",
        value="Euclidean distance in dB between mean samples; WKNN: inverse distance; −100 dBm for missing",
        source=f"{_METHOD}; weights and missing value are not printed",
    ),
    Choice(
        what="RSS_l of eq. (1)",
        value="blocks of N survey samples, the best coefficient of a point's blocks",
        source="chosen: how the matrices are created is not printed; other readings stand in a table of their own",
    ),
    Choice(what="sign", value="eqs. (5)–(6) keep the sign of the numerator", source="needed for the order of eq. (1)"),
    Choice(
        what="map image", value="pixels of 0.1 m, walls 0.2 m thick, T_threshold 0.55", source="threshold 4.3.1; chosen"
    ),
    Choice(
        what="calibration model",
        value="the middles of the corridors in the experimental area, three aisles of the room",
        source="straight lines that represent walkways: section 3.2; chosen: where they lie",
    ),
    Choice(
        what="map alone",
        value="S_(n−1) is the point before as corrected; a first point in structure goes to the nearest walkway",
        source="chosen: figure 1 is not in the text",
    ),
    Choice(
        what="Kalman filter",
        value="ΔT 1 s; a_x, a_y of σ 0.05 m/s²; R = 6 m² on the diagonal; first speed 0 with σ 1 m/s",
        source="[sun2013] 4.3.2; first speed chosen: the plugin's default",
    ),
    Choice(
        what="surfaces",
        value=f"N in {SURFACE_N}, K in {SURFACE_K}, {len(SURFACE_STARTS)} queries a test point",
        source="1 to 20 each in figure 4; chosen: eight values",
    ),
    Choice(
        what="variants",
        value=f"readings of eq. (1), literal eq. (6): {COMPARED_PASSES} passes; plain NCC: {PLAIN_POINTS} queries",
        source="chosen: for want of time",
    ),
    Choice(
        what="“little”, “about 30 %”, “whatever the fingerprint”",
        value="a reduction of the mean error between 0 and 15 %; between 20 and 40 %; three reductions that differ by "
        "less than 10 points",
        source="chosen; the paper has 3–8 %, 28–32 %, and 4 points",
    ),
)
