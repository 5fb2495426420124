"""The positions port: estimates by topic, the last of each stream for whoever comes later, and a heartbeat."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import zmq

from tickfix.ports.clock import Clock
from tickfix.ports.publishing import Publisher
from tickfix.wire import VERSION
from tickfix.wire.replies import Envelope, Heartbeat, encode
from tickfix.wire.topics import HEARTBEAT, Family, stream_topics

_STREAMS: Final = 65_536
_AT_ONCE: Final = 256
_SHARE: Final = 10
_PREFIXES: Final = 1_000


@dataclass(frozen=True, slots=True)
class Said:
    """What a pipeline says of a device: the body goes out as it is, the very bytes in the journal.

    Attributes:
        family: ``estimate``, or ``revision`` for a tick that was published before.
        floor: the floor it says; None while there is no position.
    """

    family: Family
    site: str
    floor: str | None
    device: str
    pipeline: str
    body: bytes


@dataclass(slots=True)
class _Last:
    topics: tuple[bytes, ...]
    envelope: bytes
    body: bytes


class Positions:
    """Publishes, and serves last values.

    A new subscriber gets the last estimate of every stream that its prefix matches, under its own number: to others
    that listen there it is a repetition, which they know by that number. Revisions are news about the past and are not
    repeated. Repeating is held to a tenth of the port's time, however many subscribe at once.

    Attributes:
        publisher: what all goes through.
        repeated: how many last values were sent to new subscribers.
    """

    def __init__(self, socket: zmq.Socket[bytes], *, run: str, site: str, heartbeat_s: float, clock: Clock) -> None:
        """Serve ``socket``, a bound XPUB."""
        self.publisher = Publisher(socket)
        self._run = run
        self._site = site
        self._clock = clock
        self._period_ns = int(heartbeat_s * 1e9)
        self._began_ns = clock.monotonic_ns()
        self._next_beat_ns = self._began_ns
        self._beats = 0
        self._numbers: dict[tuple[str, str, str], int] = {}
        self._last: dict[tuple[str, str], _Last] = {}
        self._wanted: set[bytes] = set()
        self._prefixes: tuple[bytes, ...] = ()
        self._queue: deque[tuple[str, str]] = deque()
        self._repeat_from_ns = 0
        self.repeated = 0

    def publish(self, said: Sequence[Said]) -> None:
        """Send what is said, in this order."""
        self.serve()
        for one in said:
            stream = (one.family, one.device, one.pipeline)
            number = self._numbers.pop(stream, 0) + 1
            self._numbers[stream] = number
            envelope = encode(Envelope(v=VERSION, run=self._run, seq=number))
            topics = stream_topics(one.family, one.site, one.floor, one.device, one.pipeline)
            if one.family == "estimate":
                self._last[one.device, one.pipeline] = _Last(topics, envelope, one.body)
            for topic in topics:
                self.publisher.send((topic, envelope, one.body))
        while len(self._numbers) > _STREAMS:
            del self._numbers[next(iter(self._numbers))]

    def forget(self, device: str) -> None:
        """Repeat nothing of a device that left; its numbers go on should it come back."""
        for stream in [stream for stream in self._last if stream[0] == device]:
            del self._last[stream]

    def serve(self) -> None:
        """Take note of who subscribed."""
        self._wanted |= self.publisher.subscriptions()
        if len(self._wanted) > _PREFIXES:
            self._wanted = {b""}

    def repeat(self) -> None:
        """Send some of the last values that new subscribers wait for."""
        began_ns = self._clock.monotonic_ns()
        if began_ns < self._repeat_from_ns:
            return
        if not self._queue:
            if not self._wanted:
                return
            self._prefixes, self._wanted = tuple(self._wanted), set()
            self._queue.extend(self._last)
        for _ in range(min(_AT_ONCE, len(self._queue))):
            last = self._last.get(self._queue.popleft())
            for topic in () if last is None else last.topics:
                if last is not None and topic.startswith(self._prefixes):
                    self.publisher.send((topic, last.envelope, last.body))
                    self.repeated += 1
        ended_ns = self._clock.monotonic_ns()
        self._repeat_from_ns = ended_ns + (_SHARE - 1) * (ended_ns - began_ns)

    @property
    def repeats_at_ns(self) -> int | None:
        """When :meth:`repeat` has something to do; None while nobody waits for last values."""
        return self._repeat_from_ns if self._wanted or self._queue else None

    def beat(self, devices: int) -> int:
        """Send a heartbeat if it is due; return when the next one is."""
        now_ns = self._clock.monotonic_ns()
        if now_ns >= self._next_beat_ns:
            self._beats += 1
            self.serve()
            # Absolute times, so that beats do not drift; those that were slept through are not made up for.
            late = (now_ns - self._next_beat_ns) // self._period_ns
            self._next_beat_ns += (late + 1) * self._period_ns
            body = encode(
                Heartbeat(
                    v=VERSION,
                    run=self._run,
                    site=self._site,
                    wall_ns=self._clock.wall_ns(),
                    uptime_s=(now_ns - self._began_ns) / 1e9,
                    devices=devices,
                    seq=self._beats,
                )
            )
            self.publisher.send((HEARTBEAT, encode(Envelope(v=VERSION, run=self._run, seq=self._beats)), body))
        return self._next_beat_ns
