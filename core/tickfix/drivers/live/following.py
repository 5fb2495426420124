"""A second engine that folds the events and decisions of a first one, with pipelines of its own.

It may hang or die without the first one noticing: all that joins them is a subscription, which drops what a slow
follower does not take. What is missed is counted, and the devices concerned go on as after any loss of messages.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from typing import Any, Final

import msgspec
import zmq

from tickfix.api import Scan, Truth
from tickfix.client import Keys
from tickfix.client.connection import connect, open_socket
from tickfix.drivers.live.commands import obey
from tickfix.drivers.live.folding import Feed, Folding, Step
from tickfix.drivers.live.histogram import Histogram
from tickfix.drivers.live.ledger import Ledger
from tickfix.drivers.live.outbox import Outbox
from tickfix.drivers.live.settings import LiveSettings
from tickfix.drivers.live.speaker import Speaker
from tickfix.ports import Clock, Hub
from tickfix.wire import FollowEnvelope, WireError, decode_event
from tickfix.wire.decisions import Drop, Finish, Fold, Run, decode_decision

_IDLE_MS: Final = 200
_MOST: Final = 2_000


@dataclass(frozen=True, slots=True)
class Leader:
    """The engine to follow: address of its follow port, and keys where it asks for them."""

    address: str
    keys: Keys | None = None


class Follower:
    """Runs until it is told to stop.

    Args:
        leader: the engine to follow.
        replica: begun, or restored.
        hub: its own; nothing comes in by its sensors port.
        names: of the pipelines, in their order.
        after_round: called after each round, at least four times a second.
        tell: told, in a sentence, what an operator must know.
    """

    def __init__(
        self,
        leader: Leader,
        replica: Folding,
        hub: Hub,
        ledger: Ledger,
        settings: LiveSettings,
        *,
        site: str,
        names: Sequence[str],
        clock: Clock | None = None,
        after_round: Callable[[Follower], None] = lambda _: None,
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Connect; that nobody is there yet is no error."""
        self._address = leader.address
        self._replica = replica
        self._hub = hub
        self._ledger = ledger
        self._names = tuple(names)
        self._clock = Clock() if clock is None else clock
        self._after_round = after_round
        self._tell = tell
        self._outbox = Outbox(hub, ledger, on_disk=False, tell=tell)
        self._speaker = Speaker(replica, ledger, self._outbox, settings, site=site, names=names, clock=self._clock)
        self._own: dict[int, tuple[int, str]] = {}
        self._steps: list[tuple[Step, str]] = []
        self._run = ""
        self._seq = 0
        self._stopping = False
        self.counts: Counter[str] = Counter()
        self.work = Histogram()
        hub.refuse_all("this engine follows another one; send to that")
        self._socket = open_socket(zmq.SUB, leader.keys, None)
        self._socket.setsockopt(zmq.RCVHWM, 100_000)
        for kind in (b"event", b"decision"):
            self._socket.subscribe(kind)
        connect(self._socket, leader.address)

    def serve(self) -> None:
        """Run until told to stop, by :meth:`stop` or over the control port."""
        try:
            while not self._stopping:
                self._round()
        finally:
            self._socket.close()

    def stop(self) -> None:
        """Stop after this round; from any thread."""
        self._stopping = True

    def adopt(self) -> None:
        """Take over what the replica was restored with; what came meanwhile was missed."""

    def report(self) -> dict[str, Any]:
        """Return what an operator wants to know, as plain values."""
        books = self._replica.books()
        return {
            "following": self._address,
            "leader": self._run,
            "devices": books.devices,
            "ticks": self._speaker.ticks,
            "lateness_ms": self._speaker.lateness.summary(),
            "work_ms": self.work.summary(),
            "measurements": books.measurements,
            "failures": books.failures,
            "journal": self._ledger.status(),
            "overload": self._outbox.full or None,
            "primary": self._speaker.primary,
            "comparison": self._speaker.contest.report(),
            "followed": dict(self.counts),
        }

    def devices(self, most: int) -> tuple[dict[str, Any], ...]:
        """Return how far each device has come, ``most`` of them."""
        return tuple(
            {"device": device, "epoch": s.epoch, "newest_ns": s.newest_ns, "next_tick": s.next_tick}
            for device, s in islice(self._replica.standings().items(), most)
        )

    def _round(self) -> None:
        ready = self._socket.poll(_IDLE_MS)
        begun_ns = self._clock.monotonic_ns()
        for item in self._hub.take(0.0):
            stops = obey(item, self._hub, self._replica, self._ledger, self._names, self._drain)
            self._stopping = self._stopping or stops
        taken = 0
        with suppress(zmq.Again):
            while ready and taken < _MOST and not self._outbox.full and not self._stopping:
                self._take(self._socket.recv_multipart(zmq.NOBLOCK), begun_ns)
                taken += 1
        self._do_steps(begun_ns)
        self._outbox.flush(self._replica.snapshot, begun_ns)
        if taken:
            self.work.add((self._clock.monotonic_ns() - begun_ns) * 1e-6)
        self._after_round(self)

    def _take(self, frames: list[bytes], now_ns: int) -> None:
        try:
            kind, envelope, body = frames
            head = msgspec.msgpack.decode(envelope, type=FollowEnvelope)
            self._notice(head)
            if kind == b"event":
                self._event(head.number, body, now_ns)
            else:
                self._decide(body, now_ns)
            self.counts["records"] += 1
        except (ValueError, WireError, msgspec.MsgspecError) as error:
            self.counts["malformed"] += 1
            self._tell(f"{self._address}: a record that cannot be used: {error}")

    def _notice(self, head: FollowEnvelope) -> None:
        if head.run != self._run:
            if self._run:
                self._tell(f"{self._address}: the engine runs anew as {head.run}")
            self._run, self._own = head.run, {}
        elif head.seq > self._seq + 1:
            self.counts["missed"] += head.seq - self._seq - 1
            self._tell(f"{self._address}: missed {head.seq - self._seq - 1} records")
        self._seq = head.seq

    def _event(self, number: int, body: bytes, now_ns: int) -> None:
        event = decode_event(body)
        self._before_what_says_nothing(now_ns)
        own = self._ledger.event(event, body)
        if isinstance(event, Truth):
            self._speaker.contest.truth(event)
        elif isinstance(event, Scan):
            self._own[number] = own, event.device
        self._steps.append((Feed(own, event, body), event.device))

    def _decide(self, body: bytes, now_ns: int) -> None:
        """Do what the first engine decided; its numbers of records are not ours."""
        decision = decode_decision(body)
        if isinstance(decision, Run | Finish):
            self._steps.append((decision, decision.device))
        elif isinstance(decision, Fold | Drop):
            number, device = self._own.pop(decision.number, (0, ""))
            if not number:
                self.counts["decisions about records that were missed"] += 1
                return
            self._before_what_says_nothing(now_ns)
            decision = msgspec.structs.replace(decision, number=number)
            self._ledger.decision(decision, device, 0)
            self._steps.append((decision, device))

    def _before_what_says_nothing(self, now_ns: int) -> None:
        """Do what says something first: what it says stands in the journal before what comes after it."""
        if self._steps and isinstance(self._steps[-1][0], Run | Finish):
            self._do_steps(now_ns)

    def _do_steps(self, now_ns: int) -> None:
        steps, self._steps = self._steps, []
        for (step, device), done in zip(steps, self._replica.apply([step for step, _ in steps]), strict=True):
            if isinstance(step, Run | Finish):
                self._ledger.decision(step, device, 0)
                self._speaker.say(done.said, now_ns)
            if isinstance(step, Finish):
                self._speaker.contest.finish(device)
            if isinstance(step, Run | Finish) and done.standing is None:
                self._hub.forget(device)

    def _drain(self) -> None:
        """Settle all that was followed; what the first engine goes on to say is not for this one any more."""
        now_ns = self._clock.monotonic_ns()
        self._do_steps(now_ns)
        self._steps = [(Finish(device=each, reason="drained"), each) for each in self._replica.standings()]
        self._do_steps(now_ns)
