"""What of the twin is printed in [wang2015], and what had to be chosen. Fixed before any result was seen.

One thing was mended afterwards: the noise of fixes was learnt together with the instant they describe, which made some
seeds' fixes wait for the tick after their epoch; now one σ is calibrated, and fixes belong to their epochs.
"""

from __future__ import annotations

from typing import Final

from tickfix.reproduction.report import Choice
from tickfix.reproduction.wang2015.site import POWER_DBM, SPACING_M
from tickfix.reproduction.wang2015.walks import DIRECTIONS, SCANS

_ROWS: Final = (
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
    ("propagation and magnetic field", "the simulator's defaults, drawn anew by each seed", "chosen: not printed"),
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
        "one scan every 2 s, at an instant and told at once",
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
        "PDR: the true place, as its error begins at nought in Figure 16; all others: their first Wi-Fi position",
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

CHOICES: Final = tuple(Choice(what=what, value=value, source=source) for what, value, source in _ROWS)
