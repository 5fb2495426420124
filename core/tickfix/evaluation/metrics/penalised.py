"""The score of the EvAAL and IPIN competitions: the third quartile of errors, wrong floors costing 15 m each."""

from __future__ import annotations

from typing import Final

import numpy as np

from tickfix.api import Floats, Ints

FLOOR_PENALTY_M: Final = 15.0


def penalised_errors(error_m: Floats, floors_off: Ints) -> Floats:
    """Return (n,) e + 15 m · |storeys off| [potorti2017]."""
    return np.asarray(error_m + FLOOR_PENALTY_M * floors_off)
