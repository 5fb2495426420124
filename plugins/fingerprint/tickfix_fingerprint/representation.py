"""How signal strengths are represented before they are compared.

All representations are zero for what was not heard and grow with the strength. Source of the four and of their names:
[torres-sospedra2015] Torres-Sospedra et al., "Comprehensive analysis of distance and similarity measures for Wi-Fi
fingerprinting indoor positioning systems", Expert Systems with Applications 42 (2015), section 3.1.
"""

from __future__ import annotations

from typing import Final, Literal, TypeAlias

import numpy as np

from tickfix.api import Floats

Representation: TypeAlias = Literal["positive", "exponential", "powed"]

_ALPHA: Final = 24.0
_BETA: Final = np.e


def represent(rssi_dbm: Floats, representation: Representation, missing_dbm: float) -> Floats:
    """Return ``rssi_dbm`` (any shape; ``missing_dbm`` or less, or NaN: not heard) in another representation.

    ``positive`` is linear in dBm: differences between values are those between the dBm. ``exponential`` and ``powed``
    are normalised to 1 at 0 dBm and let weak readings, which are mostly noise, count less.
    """
    positive = np.maximum(np.nan_to_num(rssi_dbm, nan=missing_dbm) - missing_dbm, 0.0)
    if representation == "positive":
        return positive
    if representation == "exponential":
        exponential: Floats = np.where(positive > 0.0, np.exp((positive + missing_dbm) / _ALPHA), 0.0)
        return exponential
    powed: Floats = (positive / -missing_dbm) ** _BETA
    return powed
