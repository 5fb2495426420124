"""What the twin of [jiang2015] is made of: what the text prints, and what we chose before any result was seen."""

from __future__ import annotations

from typing import Final

from tickfix.reproduction.report import Choice

_PRINTED_AND_CHOSEN: Final = (
    ("room", "8.5 m × 12 m, one room with four walls", "printed, section 8.1; no furniture is printed"),
    (
        "room in the floor's frame",
        "turned clockwise by 30°",
        "chosen: a plain angle jumps at due south, where the printed regression cannot work: no straight lies there",
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
        "taken anew for each walk: σ 3° in yaw, 4° in pitch, 2° in roll",
        "chosen: nobody holds alike",
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
        "constant velocity, accelerations of σ 0.5 m/s²; places of σ 0.5 m reckoned, 1.5 m by Wi-Fi",
        "chosen: no model is printed",
    ),
    ("gait", "0.7 m a step, the plugin's defaults", "chosen: “a default step length” is printed"),
    (
        "tests",
        "each of the 4 people walks the route once at the own pace, with the phone of the fingerprints",
        "printed in words, section 8.1: a user with a phone, along the same route; how many is chosen",
    ),
    ("start", "told, with σ 0.1 m, to all that use motion", "printed, section 5: the start must be given"),
    (
        "errors, Table 4 and Fig. 16",
        "every published estimate against the true place at its tick",
        "chosen: the text says mean error",
    ),
    (
        "errors, Fig. 14",
        "what each location result made the method say, against the true place at that tick",
        "chosen; results that are older because the phone told them late are not blamed for it",
    ),
)

CHOICES: Final = tuple(Choice(what=what, value=value, source=source) for what, value, source in _PRINTED_AND_CHOSEN)
