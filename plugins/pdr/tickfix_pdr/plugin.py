"""What this package offers."""

from __future__ import annotations

from tickfix.api import hookimpl
from tickfix_pdr.elm import ElmPdr
from tickfix_pdr.gait import Gait
from tickfix_pdr.multi_threshold import MultiThreshold
from tickfix_pdr.pseudo_odometry import PseudoOdometry
from tickfix_pdr.steps import StepsPdr

TICKFIX_API = 1


@hookimpl
def tickfix_register() -> list[type]:
    """Offer dead reckoning."""
    return [StepsPdr, Gait, MultiThreshold, PseudoOdometry, ElmPdr]
