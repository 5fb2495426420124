"""Which floor a filter is on: it changes when several fixes in a row say the same other one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

_PATIENCE: Final = 3


@dataclass(frozen=True, slots=True)
class OnFloor:
    """The floor believed in, and how often in a row another one was observed."""

    floor: str
    other: str = ""
    times: int = 0

    def observe(self, floor: str) -> OnFloor:
        """Return what to believe after a fix on ``floor``."""
        if floor == self.floor:
            return OnFloor(self.floor)
        times = self.times + 1 if floor == self.other else 1
        return OnFloor(floor) if times >= _PATIENCE else OnFloor(self.floor, floor, times)
