"""The I/O thread that owns all sockets: its call queue, the backlog of publications, and its poll loop."""

from __future__ import annotations

import logging
import threading
from collections import Counter, deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from socket import socketpair
from typing import Any, Final

import zmq

from tickfix.ports.authentication import AllowList, ZapAuthenticator
from tickfix.ports.control_port import ControlPort
from tickfix.ports.port_settings import Clock
from tickfix.ports.publishers import FollowPort, PositionsPort
from tickfix.ports.sensors_port import SensorsPort
from tickfix.ports.sockets import PortSockets

_LOGGER = logging.getLogger(__name__)

_WAKE_READ_BYTES = 4_096


class CallQueue:
    """Things that other threads want done by the one that owns the sockets.

    Attributes:
        wake: to be polled by the owner; readable when calls are queued.
    """

    def __init__(self) -> None:
        """Begin with none."""
        self.wake, self._wake_writer = socketpair()
        self.wake.settimeout(0.0)
        self._wake_writer.settimeout(0.0)
        self._calls: deque[Callable[[], None]] = deque()
        self._signalled = False

    def __len__(self) -> int:
        """Return how many wait."""
        return len(self._calls)

    def add(self, call: Callable[[], None]) -> None:
        """Have ``call`` run by the owner; from any thread."""
        self._calls.append(call)
        if not self._signalled:
            self._signalled = True
            # A full buffer already wakes the reader; a closed one has no reader left.
            with suppress(OSError):
                self._wake_writer.send(b"\0")

    def run(self, max_items: int) -> None:
        """Run at most ``max_items`` queued calls, in the order in which they were added."""
        # Clear the flag first: an item added from here on sets it again.
        self._signalled = False
        with suppress(BlockingIOError):
            self.wake.recv(_WAKE_READ_BYTES)
        for _ in range(min(max_items, len(self._calls))):
            self._calls.popleft()()

    def close(self) -> None:
        """Free the descriptors."""
        self.wake.close()
        self._wake_writer.close()


_CHUNK_SIZE: Final = 64
_MAX_WAITING: Final = 200_000


class PublicationBacklog:
    """Hands publications to the thread of the ports, so that incoming messages get their turns in between.

    Attributes:
        discarded: publications given up because too many waited; that happens only when the thread is stuck.
    """

    def __init__(self, call_queue: CallQueue) -> None:
        """Begin with nothing."""
        self._call_queue = call_queue
        self._lock = threading.Lock()
        self._waiting = 0
        self.discarded = 0

    def add(self, items: Sequence[Any], publish: Callable[[Sequence[Any]], None]) -> None:
        """Have ``publish`` called with all items, in order, on the thread of the ports."""
        with self._lock:
            taken = items[: _MAX_WAITING - self._waiting]
            self._waiting += len(taken)
            self.discarded += len(items) - len(taken)
        for begin in range(0, len(taken), _CHUNK_SIZE):
            self._call_queue.add(partial(self._publish, publish, taken[begin : begin + _CHUNK_SIZE]))

    def _publish(self, publish: Callable[[Sequence[Any]], None], chunk: Sequence[Any]) -> None:
        with self._lock:
            self._waiting -= len(chunk)
        publish(chunk)


_CALLS_PER_ROUND: Final = 32
_ALLOW_LIST_INTERVAL_NS: Final = 500_000_000
_MIN_ROUND_NS: Final = 1_000_000
"""Where nothing is left to do, rounds begin no closer: waking for every message would cost more than serving it."""


class IoLoop:
    """Waits for sockets, queued calls and due times, and serves each in turn.

    Attributes:
        errors: unexpected exceptions of single ports, by type; they close nothing.
    """

    def __init__(
        self,
        ports: PortSockets,
        call_queue: CallQueue,
        *,
        sensors: SensorsPort,
        control: ControlPort,
        positions: PositionsPort,
        following: FollowPort | None,
        authenticator: ZapAuthenticator | None,
        allowed: AllowList | None,
        clock: Clock,
    ) -> None:
        """Prepare to serve these."""
        self._ports = ports
        self._call_queue = call_queue
        self._sensors = sensors
        self._control = control
        self._positions = positions
        self._follow_port = following
        self._authenticator = authenticator
        self._allowed = allowed
        self._clock = clock
        self._next_refresh_ns = 0
        self.errors: Counter[str] = Counter()
        self._register_sockets()

    def serve(self, ended: Callable[[], bool]) -> None:
        """Loop until ``ended``, then run the calls that are left."""
        while not ended():
            ready = dict(self._poller.poll(self._wait_ms()))
            started_ns = self._clock.monotonic_ns()
            # First the calls of the loop, so that they apply to messages that come in now.
            self._run_guarded(self._run_calls)
            more = False
            for socket, serve in self._services.items():
                if socket in ready:
                    more = self._run_guarded(serve) is True or more
            self._run_guarded(self._positions.send_last_values)
            self._refresh_allow_list()
            left_ns = started_ns + _MIN_ROUND_NS - self._clock.monotonic_ns()
            if left_ns > 0 and not more and not self._call_queue:
                self._clock.sleep(left_ns * 1e-9)
        while self._call_queue:
            self._run_guarded(self._run_calls)

    def _register_sockets(self) -> None:
        """Have the sockets that are open now polled and served."""
        serves: dict[str, Callable[[], Any]] = {
            "positions": self._positions.serve,
            "control": self._control.serve,
            "sensors": self._sensors.serve,
        }
        if self._follow_port is not None:
            serves["follow"] = self._follow_port.serve
        if self._authenticator is not None:
            serves["authenticator"] = self._authenticator.serve
        self._services = {self._ports[name]: serve for name, serve in serves.items()}
        self._poller = zmq.Poller()
        self._poller.register(self._call_queue.wake, zmq.POLLIN)
        for socket in self._services:
            self._poller.register(socket, zmq.POLLIN)
        self._paused: set[str] = set()

    def _wait_ms(self) -> int:
        """Return how long there is nothing to do unless something comes in; ports that pause are not listened to."""
        now_ns = self._clock.monotonic_ns()
        due_ns = [self._positions.send_heartbeat(len(self._sensors.device_sessions)), self._next_refresh_ns]
        for name, until_ns in (
            ("sensors", self._sensors.paused_until_ns),
            ("control", self._control.paused_until_ns),
        ):
            pauses = until_ns > now_ns
            if pauses is not (name in self._paused):
                self._poller.modify(self._ports[name], 0 if pauses else zmq.POLLIN)
                self._paused ^= {name}
            if pauses:
                due_ns.append(until_ns)
        if (last_values_ns := self._positions.last_values_due_ns) is not None:
            due_ns.append(last_values_ns)
        return 0 if self._call_queue else max(0, -(-(min(due_ns) - now_ns) // 1_000_000))

    def _refresh_allow_list(self) -> None:
        """See now and then whether the allow-list has changed, and cut off listeners that lost their place on it."""
        now_ns = self._clock.monotonic_ns()
        if now_ns < self._next_refresh_ns:
            return
        self._next_refresh_ns = now_ns + _ALLOW_LIST_INTERVAL_NS
        if self._allowed is None:
            return
        publishers = {"positions": self._positions.publisher}
        if self._follow_port is not None:
            publishers["follow"] = self._follow_port.publisher
        self._allowed.refresh()
        for name in self._allowed.pop_revoked_ports() & publishers.keys():
            publishers[name].attach(self._ports.reopen(name))
            self._register_sockets()

    def _run_calls(self) -> None:
        self._call_queue.run(_CALLS_PER_ROUND)

    def _run_guarded(self, serve: Callable[[], Any]) -> Any:
        try:
            return serve()
        except Exception as problem:
            error = f"{type(problem).__name__}: {problem}"[:200]
            if not self.errors[error]:
                _LOGGER.exception("a port failed, please report this", extra={"code": "port_failed"})
            self.errors[error] += 1
            return None
