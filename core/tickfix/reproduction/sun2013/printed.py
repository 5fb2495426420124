"""What [sun2013] prints: its tables, word for word in numbers."""

from __future__ import annotations

from typing import Final

from tickfix.reproduction.sun2013.pipelines import FNCC, KF, KMF, KNN, MAP, WKNN

COLUMNS: Final = ("mean, m", "σ, m", "≤ 2 m, %", "≤ 3 m, %")

ERRORS: Final[dict[str, tuple[float | None, ...]]] = {
    KNN: (2.77, 1.91, 39.6, 64.7),
    WKNN: (2.74, 1.91, 41.2, 65.4),
    FNCC: (2.60, 1.93, 45.9, 68.9),
    KNN + MAP: (2.62, 1.90, 43.5, 67.4),
    WKNN + MAP: (2.57, 1.89, 45.4, 68.7),
    FNCC + MAP: (2.39, 1.85, 51.0, 73.0),
    # The plain Kalman filter's mean errors stand in section 4.3.2.
    KNN + KF: (2.65, None, None, None),
    WKNN + KF: (2.65, None, None, None),
    FNCC + KF: (2.41, None, None, None),
    KNN + KMF: (1.88, 1.24, 61.0, 83.0),
    WKNN + KMF: (1.90, 1.27, 61.6, 83.0),
    FNCC + KMF: (1.87, 1.24, 61.3, 85.1),
}
"""Tables 2, 4 and 5."""

OPERATIONS: Final[dict[str, tuple[int, int, int]]] = {
    "KNN": (1559, 821, 91),
    "WKNN": (1571, 835, 91),
    "NCC (1)": (11023, 5280, 182),
    "FNCC (5)": (9476, 3642, 0),
    "FNCC (6)": (6382, 3824, 0),
}
"""Section 4.2.2: additions, multiplications, square roots."""

SAVED: Final = (4641, 1456, 182)
"""What eq. (6) saves over eq. (1), as printed."""


def reduction_percent(system: str, fingerprint: str) -> float:
    """Return by how much the printed mean error of a system is below that of its fingerprint alone, per cent."""
    before, after = ERRORS[fingerprint][0], ERRORS[system][0]
    assert before is not None  # noqa: S101 - each has a mean
    assert after is not None  # noqa: S101 - as above
    return 100.0 * (before - after) / before
