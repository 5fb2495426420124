"""What this package offers."""

from __future__ import annotations

from tickfix.api import hookimpl
from tickfix_maps.image import Image
from tickfix_maps.regions import Regions
from tickfix_maps.walls import Walls

TICKFIX_API = 1


@hookimpl
def tickfix_register() -> list[type]:
    """Offer the maps."""
    return [Image, Regions, Walls]
