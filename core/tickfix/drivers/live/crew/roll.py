"""What concerns all devices: who is followed and where, which numbers were seen, which scans wait, what is published.

A crew keeps it beside the loop. Each worker knows the same of its own devices, by the same code.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from hashlib import blake2b

from tickfix.api import Event, Scan, Truth
from tickfix.drivers.live.folding import Feed, Step
from tickfix.kernel import KernelSnapshot, Sessions
from tickfix.wire.decisions import Drop, Finish, Fold, Primary


class Roll:
    """Keeps up with the steps of a run without folding anything.

    Attributes:
        sessions: the message numbers seen, and who is gone; numbers of epochs are the workers' affair.
        followed: devices, in the order of their first event.
        waiting: scans that no decision has spoken of yet, by the number of their record.
        primary: the pipeline that is published; empty means that none was chosen.
    """

    def __init__(self) -> None:
        """Begin with nothing."""
        self.sessions = Sessions()
        self.followed: dict[str, None] = {}
        self.waiting: dict[int, Scan] = {}
        self.primary = ""

    def enter(self, step: Step) -> tuple[str | None, list[str]]:
        """Take note of a step.

        Returns:
            The device that it concerns, None for a step that concerns none; and devices that are forgotten for it.
        """
        if isinstance(step, Feed):
            if isinstance(step.event, Scan):
                self.waiting[step.number] = step.event
            else:
                self._feed(step.event)
            return step.event.device, []
        if isinstance(step, Fold | Drop):
            scan = self.waiting.pop(step.number, None)
            if scan is None:
                return None, []
            if isinstance(step, Fold):
                self._feed(scan)
            return scan.device, []
        if isinstance(step, Primary):
            self.primary = step.pipeline
            return None, []
        if isinstance(step, Finish) and step.device in self.followed:
            del self.followed[step.device]
            return step.device, self.sessions.retire(step.device, 0)
        return step.device, []

    def lose(self, devices: Iterable[str]) -> list[str]:
        """Take note that devices are followed no more, though nobody said so; return who is forgotten for them."""
        forgotten = []
        for device in devices:
            del self.followed[device]
            forgotten += self.sessions.retire(device, 0)
        return forgotten

    def restore(self, kernel: KernelSnapshot, waiting: Iterable[tuple[int, Scan]], primary: str) -> None:
        """Become what a snapshot says."""
        self.sessions.restore(kernel.sessions, kernel.retired)
        self.followed.update(dict.fromkeys(device.device for device in kernel.devices))
        self.waiting.update(waiting)
        self.primary = primary

    def _feed(self, event: Event) -> None:
        if isinstance(event, Truth):
            return
        is_new, _ = self.sessions.enter(event)
        if is_new and event.device not in self.followed:
            self.sessions.begin(event.device)
            self.followed[event.device] = None


@lru_cache(maxsize=65_536)
def owner(device: str, workers: int) -> int:
    """Return the number of the worker that a device belongs to."""
    digest = blake2b(device.encode("utf-8", "surrogatepass"), digest_size=8).digest()
    return int.from_bytes(digest, "little") % workers
