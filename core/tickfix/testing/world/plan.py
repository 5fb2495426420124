"""Two floors of 20 m × 12 m: ``F1`` with an obstacle and a wall that a door leads through, ``F2`` without the wall."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Final

import numpy as np

from tickfix.api import Floor

WIDTH_M: Final = 20.0
HEIGHT_M: Final = 12.0


@cache
def floors() -> Mapping[str, Floor]:
    """Return the two floors by name."""
    outline = np.array([[0.0, 0.0], [WIDTH_M, 0.0], [WIDTH_M, HEIGHT_M], [0.0, HEIGHT_M]])
    block = np.array([[7.0, 4.0], [13.0, 4.0], [13.0, 8.0], [7.0, 8.0]])
    wall = np.array([[[5.0, 0.0], [5.0, 4.5]], [[5.0, 6.0], [5.0, HEIGHT_M]]])  # the door is between the two
    size = {"width_m": WIDTH_M, "height_m": HEIGHT_M, "outline": (outline,), "obstacles": (block,)}
    return MappingProxyType(
        {"F1": Floor(name="F1", level=0, walls=wall, **size), "F2": Floor(name="F2", level=1, **size)}  # type: ignore[arg-type]
    )
