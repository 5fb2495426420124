"""What the loop knows of each device: how far it has come, how much of it waits, and when its next tick is due."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Any

from tickfix.drivers.live.loop.deadlines import Deadlines
from tickfix.kernel import Standing


class Devices:
    """The devices that are followed.

    Attributes:
        deadlines: by which their next ticks close.
    """

    def __init__(self, deadlines: Deadlines) -> None:
        """Begin with none."""
        self.deadlines = deadlines
        self._standings: dict[str, Standing] = {}
        self._behind: dict[str, int] = {}

    def __contains__(self, device: str) -> bool:
        """Whether a device is followed."""
        return device in self._standings

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the devices; some may be forgotten meanwhile."""
        return iter(tuple(self._standings))

    def adopt(self, standings: Mapping[str, Standing], now_ns: int) -> None:
        """Take over devices as a replica was restored with them; ``now_ns`` is when they count as heard."""
        for device, standing in standings.items():
            self.stands(device, standing)
            self.heard(device, now_ns)

    def stands(self, device: str, standing: Standing) -> None:
        """Take note of how far a device has come."""
        self._standings[device] = standing

    def heard(self, device: str, received_ns: int) -> None:
        """Take note that something of a device was let in, which was received at ``received_ns`` on our clock."""
        standing = self._standings.get(device)
        if standing is not None and standing.newest_ns is not None:
            self.deadlines.heard(device, standing.newest_ns, standing.next_tick, arrived_ns=received_ns)

    def ran(self, device: str, standing: Standing | None) -> None:
        """Take note of how far a run has brought a device; None where the device is not followed."""
        self._behind.pop(device, None)
        if standing is not None:
            self.deadlines.closed(device, standing.next_tick)
            if standing.behind:
                self._behind[device] = standing.behind

    def behind(self, device: str) -> int:
        """Return how many ticks of a device wait to be folded."""
        return self._behind.get(device, 0)

    @property
    def any_behind(self) -> bool:
        """Whether ticks of some device wait to be folded."""
        return bool(self._behind)

    def next_behind(self) -> str | None:
        """Return one of the devices that are behind, each in its turn; None when none is."""
        if not self._behind:
            return None
        device = next(iter(self._behind))
        self._behind[device] = self._behind.pop(device)
        return device

    def forget(self, device: str) -> None:
        """Let go of a device."""
        self._standings.pop(device, None)
        self._behind.pop(device, None)
        self.deadlines.forget(device)

    def listed(self, most: int) -> tuple[dict[str, Any], ...]:
        """Return how far each device has come, ``most`` of them, as plain values."""
        return tuple(
            {
                "device": device,
                "epoch": standing.epoch,
                "newest_ns": standing.newest_ns,
                "next_tick": standing.next_tick,
                "clock_offset_ns": self.deadlines.offset_ns(device),
            }
            for device, standing in islice(self._standings.items(), most)
        )
