"""The outbound ports, both XPUB and never blocking.

Positions (topics, last-value cache, heartbeat) and follow (journal records).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias, cast

import zmq

from tickfix.ports.port_settings import Clock
from tickfix.wire import VERSION
from tickfix.wire.engine_messages import FollowEnvelope, HeartbeatMessage, PublicationEnvelope, encode_engine_message
from tickfix.wire.estimate_codec import HEARTBEAT_TOPIC, TopicFamily, stream_topics

_SEND_LAST: Final = int(zmq.NOBLOCK)
_SEND_MORE: Final = int(zmq.NOBLOCK | zmq.SNDMORE)
"""Plain numbers: joining flags for every frame takes longer than handing the frame over."""

_ZMQ_EVENTS: Final = int(zmq.EVENTS)
_ZMQ_POLLIN: Final = int(zmq.POLLIN)
_SUBSCRIPTIONS_PER_CALL: Final = 1_000
_MAX_FILTER_PREFIXES: Final = 32
_MATCH_ALL: Final = (b"",)


class XpubPublisher:
    """An XPUB socket that drops for slow listeners only, and counts how often that began.

    libzmq drops for a listener whose queue is full without a word. Asked not to drop, it refuses a message once some
    queue has filled up; sent again with leave to drop, the message reaches everyone else. From then on that listener is
    left out, unseen, until it has read enough. So ``stalls`` counts how often a listener fell behind, not how many
    messages it missed: those it sees itself, by their sequence.

    What nobody has ever subscribed to is not handed to libzmq: that would be three frames for nothing, and with each of
    them the interpreter's lock may change hands. Subscriptions count from the next call of :meth:`poll_subscriptions`
    on.
    That listeners leave is not looked at, since libzmq also passes on what one unsubscribes from and never had.

    Attributes:
        sent: messages published, whether or not somebody listens.
        sent_bytes: their bodies' bytes.
        stalls: how often a listener's queue was found full.
    """

    def __init__(self, socket: zmq.Socket[bytes]) -> None:
        """Publish on ``socket``, a bound XPUB."""
        self.attach(socket)
        self.sent = 0
        self.sent_bytes = 0
        self.stalls = 0

    def attach(self, socket: zmq.Socket[bytes]) -> None:
        """Publish on this socket from now on."""
        self._socket = socket
        self._prefixes: tuple[bytes, ...] = ()
        socket.setsockopt(zmq.XPUB_VERBOSE, 1)
        socket.setsockopt(zmq.XPUB_NODROP, 1)

    def send(self, frames: tuple[bytes, bytes, bytes]) -> None:
        """Publish one message: topic, envelope, body."""
        if frames[0].startswith(self._prefixes):
            try:
                self._send(frames)
            except zmq.Again:
                self.stalls += 1
                self._socket.setsockopt(zmq.XPUB_NODROP, 0)
                self._send(frames)
                self._socket.setsockopt(zmq.XPUB_NODROP, 1)
        self.sent += 1
        self.sent_bytes += len(frames[-1])

    def _send(self, frames: tuple[bytes, bytes, bytes]) -> None:
        topic, envelope, body = frames
        send = self._socket.send
        send(topic, _SEND_MORE)
        send(envelope, _SEND_MORE)
        send(body, _SEND_LAST)

    def poll_subscriptions(self) -> set[bytes]:
        """Return the topics that listeners have subscribed to since the last call; to be called before :meth:`send`."""
        topics: set[bytes] = set()
        if not cast(int, self._socket.getsockopt(_ZMQ_EVENTS)) & _ZMQ_POLLIN:
            return topics
        for _ in range(_SUBSCRIPTIONS_PER_CALL):
            try:
                frame = self._socket.recv(_SEND_LAST)
            except zmq.Again:
                break
            if frame[:1] == b"\x01":
                topics.add(frame[1:])
        else:
            # Some may be unread.
            self._prefixes = _MATCH_ALL
        self._add_prefixes(topics)
        return topics

    def _add_prefixes(self, topics: set[bytes]) -> None:
        prefixes = topics.union(self._prefixes)
        self._prefixes = tuple(prefixes) if len(prefixes) <= _MAX_FILTER_PREFIXES else _MATCH_ALL


FollowRecord: TypeAlias = tuple[bytes, int, bytes]
"""Kind (``b"event"`` or ``b"decision"``), number in the journal, bytes."""

FOLLOW_KINDS: Final = (b"event", b"decision")


class FollowPort:
    """Publishes records; an engine that falls behind sees by ``seq`` that it missed some, and nobody waits for it."""

    def __init__(self, socket: zmq.Socket[bytes], *, run: str) -> None:
        """Serve ``socket``, a bound XPUB."""
        self.publisher = XpubPublisher(socket)
        self._run = run
        self._seq = 0

    def publish(self, records: Sequence[FollowRecord]) -> None:
        """Send records in this order."""
        self.serve()
        for kind, number, body in records:
            self._seq += 1
            envelope = FollowEnvelope(v=VERSION, run=self._run, number=number, seq=self._seq)
            self.publisher.send((kind, encode_engine_message(envelope), body))

    def serve(self) -> None:
        """Discard subscription messages: this port has no last values."""
        self.publisher.poll_subscriptions()


_MAX_STREAMS: Final = 65_536
_LAST_VALUES_PER_ROUND: Final = 256
_LAST_VALUE_TIME_DIVISOR: Final = 10
_MAX_PENDING_PREFIXES: Final = 1_000


@dataclass(frozen=True, slots=True)
class Publication:
    """An encoded estimate: the body is sent as it is, with the same bytes as in the journal.

    Attributes:
        family: ``estimate``, or ``revision`` for a tick that was published before.
        floor: the estimated floor; None while there is no position.
    """

    family: TopicFamily
    site: str
    floor: str | None
    device: str
    pipeline: str
    body: bytes


@dataclass(slots=True)
class _LastValue:
    topics: tuple[bytes, ...]
    envelope: bytes
    body: bytes


class PositionsPort:
    """Publishes, and serves last values.

    A new subscriber gets the last estimate of every stream that its prefix matches, under its own number: to others
    that listen there it is a repetition, which they know by that number. Revisions are news about the past and are not
    repeated. Repeating is held to a tenth of the port's time, however many subscribe together.

    Attributes:
        publisher: what all goes through.
        last_values_sent: how many last values were sent to new subscribers.
    """

    def __init__(self, socket: zmq.Socket[bytes], *, run: str, site: str, heartbeat_s: float, clock: Clock) -> None:
        """Serve ``socket``, a bound XPUB."""
        self.publisher = XpubPublisher(socket)
        self._run = run
        self._site = site
        self._clock = clock
        self._period_ns = int(heartbeat_s * 1e9)
        self._started_ns = clock.monotonic_ns()
        self._next_heartbeat_ns = self._started_ns
        self._heartbeats = 0
        self._sequence_numbers: dict[tuple[str, str, str], int] = {}
        self._last_values: dict[tuple[str, str], _LastValue] = {}
        self._new_prefixes: set[bytes] = set()
        self._prefixes: tuple[bytes, ...] = ()
        self._pending_streams: deque[tuple[str, str]] = deque()
        self._next_last_values_ns = 0
        self.last_values_sent = 0

    def publish(self, publications: Sequence[Publication]) -> None:
        """Send the estimates, in this order."""
        self.serve()
        for one in publications:
            stream = (one.family, one.device, one.pipeline)
            number = self._sequence_numbers.pop(stream, 0) + 1
            self._sequence_numbers[stream] = number
            envelope = encode_engine_message(PublicationEnvelope(v=VERSION, run=self._run, seq=number))
            topics = stream_topics(one.family, one.site, one.floor, one.device, one.pipeline)
            if one.family == "estimate":
                self._last_values[one.device, one.pipeline] = _LastValue(topics, envelope, one.body)
            for topic in topics:
                self.publisher.send((topic, envelope, one.body))
        while len(self._sequence_numbers) > _MAX_STREAMS:
            del self._sequence_numbers[next(iter(self._sequence_numbers))]

    def forget(self, device: str) -> None:
        """Repeat nothing of a device that left; its numbers go on should it come back."""
        for stream in [stream for stream in self._last_values if stream[0] == device]:
            del self._last_values[stream]

    def serve(self) -> None:
        """Take note of who subscribed."""
        self._new_prefixes |= self.publisher.poll_subscriptions()
        if len(self._new_prefixes) > _MAX_PENDING_PREFIXES:
            self._new_prefixes = {b""}

    def send_last_values(self) -> None:
        """Send some of the last values that new subscribers wait for."""
        started_ns = self._clock.monotonic_ns()
        if started_ns < self._next_last_values_ns:
            return
        if not self._pending_streams:
            if not self._new_prefixes:
                return
            self._prefixes, self._new_prefixes = tuple(self._new_prefixes), set()
            self._pending_streams.extend(self._last_values)
        for _ in range(min(_LAST_VALUES_PER_ROUND, len(self._pending_streams))):
            last = self._last_values.get(self._pending_streams.popleft())
            for topic in () if last is None else last.topics:
                if last is not None and topic.startswith(self._prefixes):
                    self.publisher.send((topic, last.envelope, last.body))
                    self.last_values_sent += 1
        ended_ns = self._clock.monotonic_ns()
        self._next_last_values_ns = ended_ns + (_LAST_VALUE_TIME_DIVISOR - 1) * (ended_ns - started_ns)

    @property
    def last_values_due_ns(self) -> int | None:
        """When :meth:`send_last_values` has something to do; None while no listener waits for last values."""
        return self._next_last_values_ns if self._new_prefixes or self._pending_streams else None

    def send_heartbeat(self, devices: int) -> int:
        """Send a heartbeat if it is due; return when the next one is."""
        now_ns = self._clock.monotonic_ns()
        if now_ns >= self._next_heartbeat_ns:
            self._heartbeats += 1
            self.serve()
            # Absolute times, so that beats do not drift; those that were slept through are not made up for.
            late = (now_ns - self._next_heartbeat_ns) // self._period_ns
            self._next_heartbeat_ns += (late + 1) * self._period_ns
            body = encode_engine_message(
                HeartbeatMessage(
                    v=VERSION,
                    run=self._run,
                    site=self._site,
                    wall_ns=self._clock.wall_ns(),
                    uptime_s=(now_ns - self._started_ns) / 1e9,
                    devices=devices,
                    seq=self._heartbeats,
                )
            )
            self.publisher.send(
                (
                    HEARTBEAT_TOPIC,
                    encode_engine_message(PublicationEnvelope(v=VERSION, run=self._run, seq=self._heartbeats)),
                    body,
                )
            )
        return self._next_heartbeat_ns
