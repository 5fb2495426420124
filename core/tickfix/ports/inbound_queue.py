"""From ROUTER frames to the queue of the engine loop.

Bounded reads, intake counters, and a bounded queue that is fair to peers.
"""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

import zmq

from tickfix.api import Event
from tickfix.ports.peers import Peer, PeerState
from tickfix.wire import Bye, Hello, ReplyOutcome

_MAX_KEPT_FRAMES: Final = 3


@dataclass(frozen=True, slots=True)
class RouterMessage:
    """One message as it came.

    Attributes:
        identity: the routing id, with what libzmq knows about the connection.
        body: its one body; None when there were more frames than that, or none.
        delimited: an empty frame stood before the body.
        frames: how many frames there were, without the routing id.
        n_bytes: of those frames together.
    """

    identity: zmq.Frame
    body: bytes | None
    delimited: bool
    frames: int
    n_bytes: int


def receive_message(socket: zmq.Socket[bytes]) -> RouterMessage | None:
    """Return the next message, or None when there is none now.

    Frames beyond those that a message may have are dropped as they are read, never kept.
    """
    try:
        identity = socket.recv(zmq.NOBLOCK, copy=False)
    except zmq.Again:
        return None
    kept: list[bytes] = []
    count = n_bytes = 0
    more = identity.more
    while more:
        # The parts of a message arrive together, so that this never waits.
        frame = socket.recv(copy=False)
        more = frame.more
        count += 1
        n_bytes += len(frame)
        if count < _MAX_KEPT_FRAMES:
            kept.append(frame.bytes)
    delimited = count > 0 and kept[0] == b""
    if delimited and count == 2:
        return RouterMessage(identity, kept[1], delimited=True, frames=count, n_bytes=n_bytes)
    if count == 1:
        # A lone empty frame is a body, and no message.
        return RouterMessage(identity, kept[0], delimited=False, frames=count, n_bytes=n_bytes)
    return RouterMessage(identity, None, delimited=delimited, frames=count, n_bytes=n_bytes)


_MAX_REPORTED_PEERS: Final = 100
_MAX_QUEUED_COMMANDS: Final = 1_000


@dataclass(slots=True, eq=False)
class InboundMessage:
    """A message that was let in; the loop owes :meth:`Hub.answer <tickfix.ports.hub.Hub.answer>` exactly once.

    Attributes:
        event: its content; an event's ``arrival_ns`` is the wall clock at receipt, ns since 1970.
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
class ControlCommand:
    """A command received on the control port.

    Attributes:
        what: ``drain``, ``stop`` or ``primary``.
        args: its arguments.
        reply: answers it, once: whether it was done, and the data or the reason; from any thread.
    """

    what: str
    args: Mapping[str, Any]
    reply: Callable[[bool, Any], None]


InboundItem: TypeAlias = InboundMessage | ControlCommand


class IntakeCounters:
    """The books: at every instant messages in = sum of outcomes + those still pending."""

    def __init__(self) -> None:
        """Begin at zero."""
        self._lock = threading.Lock()
        self._received = 0
        self._bytes = 0
        self._outcomes: Counter[ReplyOutcome] = Counter()
        self._unknown: Counter[str] = Counter()

    def receive(self, state: PeerState, n_bytes: int) -> None:
        """Note a message in."""
        with self._lock:
            self._received += 1
            self._bytes += n_bytes
            state.received += 1
            state.received_bytes += n_bytes

    def count_outcome(self, state: PeerState, outcome: ReplyOutcome) -> None:
        """Note what became of a message."""
        with self._lock:
            self._outcomes[outcome] += 1
            state.outcomes[outcome] += 1

    def count_outcome_once(self, incoming: InboundMessage, outcome: ReplyOutcome) -> bool:
        """Note what became of a message that was handed to the loop, unless that was told before."""
        with self._lock:
            if incoming.answered:
                return False
            incoming.answered = True
            state = incoming.peer.state
            self._outcomes[outcome] += 1
            state.outcomes[outcome] += 1
            return True

    def count_unknown(self, what: str, count: int) -> None:
        """Note fields or sensors that are not known here and were skipped."""
        with self._lock:
            self._unknown[what] += count

    def snapshot(self, peers: Iterable[PeerState]) -> dict[str, Any]:
        """Return all counters, of one instant, with those of the peers heard last."""
        last = list(peers)[-_MAX_REPORTED_PEERS:]
        with self._lock:
            settled = sum(self._outcomes.values())
            return {
                "received": self._received,
                "received_bytes": self._bytes,
                "pending": self._received - settled,
                "outcomes": {outcome.value: self._outcomes[outcome] for outcome in ReplyOutcome},
                "unknown_skipped": dict(self._unknown),
                "peers": {
                    state.name: {
                        "received": state.received,
                        "received_bytes": state.received_bytes,
                        "outcomes": {outcome.value: n for outcome, n in state.outcomes.items()},
                    }
                    for state in reversed(last)
                },
            }


class InboundQueue:
    """The queue to the loop: bounded in messages and bytes, and shared fairly once it is half full."""

    def __init__(self, messages: int, n_bytes: int) -> None:
        """Hold at most so many messages and bytes."""
        self._most_messages = messages
        self._most_bytes = n_bytes
        self._items: deque[InboundItem] = deque()
        self._bytes = 0
        self._messages = 0
        self._peers = 0
        self._ready = threading.Condition()
        self._closed = False
        self._woken = False

    def try_put(self, incoming: InboundMessage) -> bool:
        """Put a message in, or return False if there is no room for this peer.

        While less than half is taken there is room for everyone. Beyond that a peer may hold no more than its part of
        the whole, one part for each peer that waits and one to spare, so that no one fills the queue alone.
        """
        state = incoming.peer.state
        with self._ready:
            if self._messages >= self._most_messages or self._bytes + incoming.n_bytes > self._most_bytes:
                return False
            half_full = 2 * self._messages >= self._most_messages or 2 * self._bytes >= self._most_bytes
            shares = self._peers + 2
            over = state.waiting >= self._most_messages // shares or state.waiting_bytes >= self._most_bytes // shares
            if half_full and state.waiting and over:
                return False
            self._peers += state.waiting == 0
            state.waiting += 1
            state.waiting_bytes += incoming.n_bytes
            self._messages += 1
            self._bytes += incoming.n_bytes
            self._items.append(incoming)
            self._ready.notify()
            return True

    def command(self, command: ControlCommand) -> bool:
        """Put a command in; False when too many wait already."""
        with self._ready:
            if len(self._items) - self._messages >= _MAX_QUEUED_COMMANDS:
                return False
            self._items.append(command)
            self._ready.notify()
            return True

    def take(self, timeout_s: float, max_items: int) -> list[InboundItem]:
        """Wait until something is there, or the timeout; return the oldest ``max_items`` items."""
        with self._ready:
            if not self._items and not self._closed and timeout_s > 0.0:
                self._ready.wait_for(lambda: bool(self._items) or self._closed or self._woken, timeout_s)
            self._woken = False
            taken = [self._items.popleft() for _ in range(min(max_items, len(self._items)))]
            for item in taken:
                if isinstance(item, InboundMessage):
                    state = item.peer.state
                    state.waiting -= 1
                    state.waiting_bytes -= item.n_bytes
                    self._peers -= state.waiting == 0
                    self._messages -= 1
                    self._bytes -= item.n_bytes
            return taken

    def wake(self) -> None:
        """Let the present or the next waiter return immediately."""
        with self._ready:
            self._woken = True
            self._ready.notify_all()

    def close(self) -> None:
        """Wake all waiters; the queue is closed."""
        with self._ready:
            self._closed = True
            self._ready.notify_all()

    @property
    def waiting(self) -> tuple[int, int]:
        """Messages and bytes in the queue."""
        with self._ready:
            return self._messages, self._bytes
