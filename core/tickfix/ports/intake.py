"""Counts messages in and what became of each, and hands those let in to the loop."""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

from tickfix.api import Event
from tickfix.kernel import Outcome
from tickfix.ports.peers import Account, Peer
from tickfix.wire import Bye, Hello

_SHOWN_PEERS: Final = 100
_COMMANDS: Final = 1_000


@dataclass(slots=True, eq=False)
class Incoming:
    """A message that was let in; the loop owes :meth:`Hub.answer <tickfix.ports.hub.Hub.answer>` exactly once.

    Attributes:
        event: what it tells; an event's ``arrival_ns`` is the wall clock at receipt, ns since 1970.
        peer: who sent it.
        wants_ack: the sender asked for an acknowledgement.
        received_ns: monotonic clock at receipt.
        answered: the loop has answered.
    """

    event: Event | Hello | Bye
    peer: Peer
    wants_ack: bool
    received_ns: int
    n_bytes: int = 0
    answered: bool = field(default=False, repr=False)


@dataclass(frozen=True, slots=True, eq=False)
class Command:
    """Something that the control port was told to do.

    Attributes:
        what: ``drain``, ``stop`` or ``primary``.
        args: its arguments.
        reply: answers it, once: whether it was done, and the data or the reason; from any thread.
    """

    what: str
    args: Mapping[str, Any]
    reply: Callable[[bool, Any], None]


Item: TypeAlias = Incoming | Command


class Intake:
    """The books: at every instant messages in = sum of outcomes + those still pending."""

    def __init__(self) -> None:
        """Begin at zero."""
        self._lock = threading.Lock()
        self._received = 0
        self._bytes = 0
        self._outcomes: Counter[Outcome] = Counter()
        self._tolerated: Counter[str] = Counter()

    def receive(self, account: Account, n_bytes: int) -> None:
        """Note a message in."""
        with self._lock:
            self._received += 1
            self._bytes += n_bytes
            account.received += 1
            account.received_bytes += n_bytes

    def settle(self, account: Account, outcome: Outcome) -> None:
        """Note what became of a message."""
        with self._lock:
            self._outcomes[outcome] += 1
            account.outcomes[outcome] += 1

    def settle_once(self, incoming: Incoming, outcome: Outcome) -> bool:
        """Note what became of a message that was handed to the loop, unless that was told before."""
        with self._lock:
            if incoming.answered:
                return False
            incoming.answered = True
            account = incoming.peer.account
            self._outcomes[outcome] += 1
            account.outcomes[outcome] += 1
            return True

    def tolerate(self, what: str, count: int) -> None:
        """Note fields or sensors that are not known here and were skipped."""
        with self._lock:
            self._tolerated[what] += count

    def snapshot(self, peers: Iterable[Account]) -> dict[str, Any]:
        """Return all counters, of one instant, with those of the peers heard last."""
        last = list(peers)[-_SHOWN_PEERS:]
        with self._lock:
            settled = sum(self._outcomes.values())
            return {
                "received": self._received,
                "received_bytes": self._bytes,
                "pending": self._received - settled,
                "outcomes": {outcome.value: self._outcomes[outcome] for outcome in Outcome},
                "tolerated": dict(self._tolerated),
                "peers": {
                    account.name: {
                        "received": account.received,
                        "received_bytes": account.received_bytes,
                        "outcomes": {outcome.value: n for outcome, n in account.outcomes.items()},
                    }
                    for account in reversed(last)
                },
            }


class Inbox:
    """The queue to the loop: bounded in messages and bytes, and shared fairly once it is half full."""

    def __init__(self, messages: int, n_bytes: int) -> None:
        """Hold at most so many messages and bytes."""
        self._most_messages = messages
        self._most_bytes = n_bytes
        self._items: deque[Item] = deque()
        self._bytes = 0
        self._messages = 0
        self._peers = 0
        self._ready = threading.Condition()
        self._closed = False
        self._woken = False

    def offer(self, incoming: Incoming) -> bool:
        """Put a message in, or say that there is no room for this peer.

        While less than half is taken there is room for everyone. Beyond that a peer may hold no more than its part of
        the whole, one part for each peer that waits and one to spare, so that no one fills the queue alone.
        """
        account = incoming.peer.account
        with self._ready:
            if self._messages >= self._most_messages or self._bytes + incoming.n_bytes > self._most_bytes:
                return False
            crowded = 2 * self._messages >= self._most_messages or 2 * self._bytes >= self._most_bytes
            parts = self._peers + 2
            over = account.waiting >= self._most_messages // parts or account.waiting_bytes >= self._most_bytes // parts
            if crowded and account.waiting and over:
                return False
            self._peers += account.waiting == 0
            account.waiting += 1
            account.waiting_bytes += incoming.n_bytes
            self._messages += 1
            self._bytes += incoming.n_bytes
            self._items.append(incoming)
            self._ready.notify()
            return True

    def command(self, command: Command) -> bool:
        """Put a command in; False when too many wait already."""
        with self._ready:
            if len(self._items) - self._messages >= _COMMANDS:
                return False
            self._items.append(command)
            self._ready.notify()
            return True

    def take(self, timeout_s: float, most: int) -> list[Item]:
        """Wait until something is there, or the timeout; return the oldest ``most`` items."""
        with self._ready:
            if not self._items and not self._closed and timeout_s > 0.0:
                self._ready.wait_for(lambda: bool(self._items) or self._closed or self._woken, timeout_s)
            self._woken = False
            taken = [self._items.popleft() for _ in range(min(most, len(self._items)))]
            for item in taken:
                if isinstance(item, Incoming):
                    account = item.peer.account
                    account.waiting -= 1
                    account.waiting_bytes -= item.n_bytes
                    self._peers -= account.waiting == 0
                    self._messages -= 1
                    self._bytes -= item.n_bytes
            return taken

    def wake(self) -> None:
        """Let whoever waits, or waits next, return at once."""
        with self._ready:
            self._woken = True
            self._ready.notify_all()

    def close(self) -> None:
        """Wake whoever waits; nothing will come any more."""
        with self._ready:
            self._closed = True
            self._ready.notify_all()

    @property
    def waiting(self) -> tuple[int, int]:
        """Messages and bytes in the queue."""
        with self._ready:
            return self._messages, self._bytes
