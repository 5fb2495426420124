"""Taking messages in: each is put off, known already, or written down and given to the round as a task."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from tickfix.api import Event, PluginError, Scan, Truth
from tickfix.api.errors import PortError
from tickfix.drivers.live.contest import Contest
from tickfix.drivers.live.errors import EngineError
from tickfix.drivers.live.folding import Feed, Folding
from tickfix.drivers.live.ledger import Ledger
from tickfix.drivers.live.loop.devices import Devices
from tickfix.drivers.live.loop.scans import Scans
from tickfix.drivers.live.loop.tasks import Tasks
from tickfix.drivers.live.outbox import Outbox
from tickfix.journal import JournalError
from tickfix.kernel import Outcome
from tickfix.ports import Hub, Incoming
from tickfix.wire import Bye, Hello, encode_event

_MOST_BEHIND: Final = 3_000
"""Ticks of a device that wait to be folded, when its further messages are answered ``busy``."""


class Intake:
    """Judges one message after the other.

    Args:
        tasks: of the round, to which is added what was let in.
        contest: is told the truth.
        tell: told, in a sentence, what an operator must know.

    Attributes:
        put_off: messages that were answered ``busy``, since what their device sent before has to be folded first.
        mishaps: messages that could not be taken in.
    """

    def __init__(
        self,
        replica: Folding,
        devices: Devices,
        scans: Scans,
        tasks: Tasks,
        ledger: Ledger,
        outbox: Outbox,
        hub: Hub,
        *,
        contest: Contest,
        tell: Callable[[str], None],
    ) -> None:
        """Begin with nothing taken in."""
        self._replica = replica
        self._devices = devices
        self._scans = scans
        self._tasks = tasks
        self._ledger = ledger
        self._outbox = outbox
        self._hub = hub
        self._contest = contest
        self._tell = tell
        self.put_off = 0
        self.mishaps = 0

    def take(self, item: Incoming) -> None:
        """Take a message in; whatever is wrong with it, it costs nobody else anything."""
        try:
            self._take(item)
        except (JournalError, PortError, EngineError, PluginError):
            raise
        except Exception as error:  # noqa: BLE001 - see above
            self.mishaps += 1
            self._tell(f"a message of {item.event.device!r} could not be taken in: {type(error).__name__}: {error}")
            self._hub.answer(item, Outcome.MALFORMED, f"{type(error).__name__}: {error}")

    def _take(self, item: Incoming) -> None:
        event = item.event
        if isinstance(event, Hello):
            self._outbox.answer(item, Outcome.ACCEPTED)
        elif isinstance(event, Bye):
            self._part(event, item)
        elif event.seq > 0 and self._is_known(event):
            self._outbox.answer(item, Outcome.DUPLICATE)
        elif why := self._why_not(event):
            self._put_off(item, why)
        else:
            self._let_in(event, item)

    def _let_in(self, event: Event, item: Incoming) -> None:
        if isinstance(event, Truth):
            self._contest.truth(event)
        body = encode_event(event)
        self._tasks.feed(Feed(self._ledger.event(event, body), event, body), item)

    def _part(self, bye: Bye, item: Incoming) -> None:
        self._tasks.do_now()
        if behind := self._devices.behind(bye.device):
            self._put_off(item, _waiting(behind))
            return
        self._tasks.finish(bye.device, "bye")
        self._outbox.answer(item, Outcome.ACCEPTED)

    def _put_off(self, item: Incoming, why: str) -> None:
        self.put_off += 1
        self._hub.answer(item, Outcome.BUSY, why)

    def _is_known(self, event: Event) -> bool:
        """Tell whether a message with this number came before: it waits, is gathered, or was fed."""
        return self._tasks.is_gathered(event) or self._scans.is_in_flight(event) or self._replica.repeats(event)

    def _why_not(self, event: Event) -> str:
        """Say why a device's message has to wait for what it sent before, if so."""
        behind = self._devices.behind(event.device)
        if behind > _MOST_BEHIND:
            return _waiting(behind)
        return self._scans.why_not(event.device) if isinstance(event, Scan) else ""


def _waiting(ticks: int) -> str:
    return f"{ticks} ticks of this device wait to be folded"
