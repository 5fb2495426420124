"""Receives estimates, and detects gaps, duplicates, missing heartbeats and restarts of the engine."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator
from types import TracebackType
from typing import Any, Final, Self
from urllib.parse import unquote

import zmq

from tickfix.client.connection import HandshakeMonitor, Keys, has_message, open_client_socket, unpack_message

_HEARTBEAT_TOPIC: Final = b"heartbeat"
_MAX_STREAMS: Final = 100_000
_RECEIVE_HWM: Final = 50_000
"""Estimates that may wait here: those of a thousand devices for ten seconds."""


class Listener:
    """Iterates over estimates as maps.

    Gaps are noticed by the numbers of each stream (site, device, pipeline). A subscription that chooses floors
    does not hear the numbers a stream has on other floors; for it no gaps are reported.

    Args:
        address: the engine's positions port.
        topics: prefixes; names in them are percent-encoded, and end with ``/`` to be whole.
        keys: CURVE keys, where the engine asks for them.
        on_gap: called with (site, device, pipeline, number missed).
        on_heartbeat_timeout: called with the seconds since anything was heard, once for every silence.
        on_new_run: called with the id of another run of the engine than the one heard before.
        heartbeat_timeout_s: how long is a silence; the engine sends a heartbeat every second unless set otherwise.
        timeout_s: iteration ends when no estimate came for so long; None waits for ever.
        clock: seconds, monotonic.

    Attributes:
        missed: estimates known to be missed.
        duplicates: estimates received before, as after a reconnection; they are dropped.
        run: id of the engine's run, None before anything was heard.
        heartbeat: the last heartbeat, None before the first.
    """

    def __init__(
        self,
        address: str,
        topics: Iterable[str] = ("estimate/",),
        *,
        keys: Keys | None = None,
        on_gap: Callable[[str, str, str, int], None] | None = None,
        on_heartbeat_timeout: Callable[[float], None] | None = None,
        on_new_run: Callable[[str], None] | None = None,
        heartbeat_timeout_s: float = 5.0,
        timeout_s: float | None = None,
        clock: Callable[[], float] = time.monotonic,
        context: zmq.Context[zmq.Socket[bytes]] | None = None,
    ) -> None:
        """Connect and subscribe; the engine need not be running yet.

        Raises:
            ClientError: for an address that cannot be.
        """
        self.missed = 0
        self.duplicates = 0
        self.run: str | None = None
        self.heartbeat: dict[str, Any] | None = None
        self._prefixes = tuple(topic.encode() for topic in topics)
        self._on_gap = on_gap
        self._on_heartbeat_timeout = on_heartbeat_timeout
        self._on_new_run = on_new_run
        self._heartbeat_timeout_s = heartbeat_timeout_s
        self._timeout_s = timeout_s
        self._clock = clock
        self._last_received_s = clock()
        self._heartbeat_overdue = False
        self._last: OrderedDict[tuple[str, ...], int] = OrderedDict()
        self._socket = open_client_socket(zmq.SUB, keys, context)
        self._socket.setsockopt(zmq.RCVHWM, _RECEIVE_HWM)
        for prefix in (*self._prefixes, _HEARTBEAT_TOPIC):
            self._socket.subscribe(prefix)
        self._handshake = HandshakeMonitor(self._socket, address, keys)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Go through estimates as they come, until ``timeout_s`` passed without one."""
        while (estimate := self.receive(self._timeout_s)) is not None:
            yield estimate

    def receive(self, timeout_s: float | None = None) -> dict[str, Any] | None:
        """Return the next estimate, or None when there was none within ``timeout_s``; None waits for ever.

        Raises:
            AccessDeniedError: when the engine does not let this client in.
        """
        deadline_s = None if timeout_s is None else self._clock() + timeout_s
        while True:
            if not has_message(self._socket):
                self._wait(deadline_s)
            if has_message(self._socket):
                estimate = self._handle(self._socket.recv_multipart())
                if estimate is not None:
                    return estimate
            now_s = self._clock()
            self._check_heartbeat(now_s)
            if deadline_s is not None and now_s >= deadline_s:
                return None

    def close(self) -> None:
        """Close the socket."""
        self._handshake.close()

    def __enter__(self) -> Self:
        """Return the listener itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    def _wait(self, deadline_s: float | None) -> None:
        """Wait for a message, the deadline, a heartbeat timeout, or a change of the connection."""
        heartbeat_timeout_s = None if self._heartbeat_overdue else self._last_received_s + self._heartbeat_timeout_s
        ends_s = [end_s for end_s in (deadline_s, heartbeat_timeout_s) if end_s is not None]
        self._handshake.poller.poll(int(max(0.0, 1000.0 * (min(ends_s) - self._clock()))) + 1 if ends_s else None)
        self._handshake.read_events()
        self._handshake.raise_if_denied()

    def _check_heartbeat(self, now_s: float) -> None:
        heartbeat_timeout_s = now_s - self._last_received_s
        if not self._heartbeat_overdue and heartbeat_timeout_s >= self._heartbeat_timeout_s:
            self._heartbeat_overdue = True
            if self._on_heartbeat_timeout is not None:
                self._on_heartbeat_timeout(heartbeat_timeout_s)

    def _handle(self, frames: list[bytes]) -> dict[str, Any] | None:
        self._last_received_s = self._clock()
        self._heartbeat_overdue = False
        if len(frames) != 3:
            return None
        topic, envelope, body = frames[0], unpack_message(frames[1]), unpack_message(frames[2])
        if envelope is None or body is None:
            return None
        self._update_run(str(envelope.get("run")))
        if topic == _HEARTBEAT_TOPIC:
            self.heartbeat = body
            return None
        return body if self._is_new(topic, envelope.get("seq")) else None

    def _update_run(self, run: str) -> None:
        if run == self.run:
            return
        before, self.run = self.run, run
        self._last.clear()
        if before is not None and self._on_new_run is not None:
            self._on_new_run(run)

    def _is_new(self, topic: bytes, seq: object) -> bool:
        """Compare a number with the last of its stream: the same again is no news, one too high is a gap."""
        names = topic.decode("ascii", "replace").split("/")
        if type(seq) is not int or len(names) < 4:
            return True
        stream = (names[0], names[1], names[-2], names[-1])
        last = self._last.pop(stream, None)
        self._last[stream] = seq
        if len(self._last) > _MAX_STREAMS:
            self._last.popitem(last=False)
        if last == seq:
            self.duplicates += 1
            return False
        # A smaller number within a run: the stream was numbered from 1 again, since its device left and came back.
        if last is not None and seq > last + 1 and self._covers_all_floors(topic):
            self.missed += seq - last - 1
            if self._on_gap is not None:
                site, device, pipeline = map(unquote, stream[1:])
                self._on_gap(site, device, pipeline, seq - last - 1)
        return True

    def _covers_all_floors(self, topic: bytes) -> bool:
        if topic.startswith(b"device/"):
            return True
        end_of_site = topic.index(b"/", topic.index(b"/") + 1) + 1
        return any(topic.startswith(prefix) and len(prefix) <= end_of_site for prefix in self._prefixes)
