"""What this package offers."""

from __future__ import annotations

from tickfix.api import hookimpl
from tickfix_filters.dead_reckoning import DeadReckoning
from tickfix_filters.fading_ekf import FadingEkf
from tickfix_filters.fixes import Fixes
from tickfix_filters.fusion_pf import FusionPf
from tickfix_filters.kalman import Kalman
from tickfix_filters.kalman_map import KalmanMap
from tickfix_filters.kalman_reckoning import KalmanReckoning
from tickfix_filters.map_pf import MapPf

TICKFIX_API = 1


@hookimpl
def tickfix_register() -> list[type]:
    """Offer the filters."""
    return [Fixes, DeadReckoning, Kalman, KalmanMap, KalmanReckoning, FadingEkf, FusionPf, MapPf]
