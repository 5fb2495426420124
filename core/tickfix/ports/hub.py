"""All ports of an engine, on one thread of their own."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import zmq

from tickfix.api.errors import PortError
from tickfix.kernel import Outcome
from tickfix.ports.addresses import parse_address, require_keys
from tickfix.ports.authentication import ENDPOINT, AllowList, Doorkeeper
from tickfix.ports.clock import Clock
from tickfix.ports.control import Control
from tickfix.ports.following import Following, Record
from tickfix.ports.intake import Inbox, Incoming, Intake, Item
from tickfix.ports.keys import ENGINE, read_pair
from tickfix.ports.peers import Peers
from tickfix.ports.positions import Positions, Said
from tickfix.ports.sensors import Sensors
from tickfix.ports.settings import PeerLimits, PortSettings
from tickfix.ports.sockets import bind, check_libzmq, demand_keys, endpoint_of, open_router, open_socket
from tickfix.ports.waking import Errands
from tickfix.wire import OLDEST_VERSION, VERSION

_NAMES: Final = ("sensors", "positions", "control", "follow")
_QUEUED: Final = {"sensors": 64, "positions": 10_000, "control": 64, "follow": 20_000}
"""High-water marks, messages per peer. What a sensor sends beyond them waits in its own connection."""

_SUBSCRIPTION_BYTES: Final = 4_096
_REQUEST_BYTES: Final = 65_536
_REQUESTS: Final = PeerLimits(messages_per_s=100.0, message_burst=200, bytes_per_s=2**20, byte_burst=2**22)
_CHUNK: Final = 64
_ERRANDS: Final = 32
_WAITING: Final = 200_000
_LOOK_NS: Final = 500_000_000
_LAST_WORDS_MS: Final = 1_000
_TRIES: Final = 400
_TRY_S: Final = 0.005


@dataclass(frozen=True, slots=True)
class Addresses:
    """Where the ports are, in full; ``follow`` is empty when nobody can follow."""

    sensors: str
    positions: str
    control: str
    follow: str


class Hub:
    """All sockets of an engine, and the one thread that touches them.

    The loop takes what came in with :meth:`take` and owes each :class:`Incoming` one :meth:`answer`; everything else
    here may be called from any thread and returns at once.

    ``describe(what, args)`` is called on the hub's thread for every request but ``drain``, ``stop`` and ``primary``
    (those come out of :meth:`take` as :class:`Command`) and ``subscribe-info`` (answered here). It must be quick and
    safe from a foreign thread, and return what MessagePack can hold; what it raises is told to who asked.
    ``tickfix status`` shows what ``describe("status", {})`` returns, a plain dict::

        {
          "run": str, "site": str, "uptime_s": float,
          "devices": int,                                   # devices followed now
          "ticks": int,                                     # ticks closed since the run began
          "lateness_ms": {"p50": float, "p99": float, "max": float},   # of a tick's deadline
          "work_ms": {"p50": float, "p99": float, "max": float},       # per round of the loop
          "intake": {outcome: int, ...},                    # hub.counters()["intake"]["outcomes"]
          "measurements": {fate: int, ...},                 # what the kernel made of single samples and readings
          "failures": {label: int, ...},                    # by pipeline and stage
          "publications": {name: int, ...},                 # hub.counters()["publications"]
          "journal": {name: int | float | str, ...},        # empty without one
          "overload": str | None,                           # why new devices are refused, None when all is well
          "pipelines": [{"name": str, "primary": bool, "state": str}, ...],
        }

    Keys that are missing are shown as unknown, further ones after these.
    """

    def __init__(
        self,
        settings: PortSettings,
        *,
        run: str,
        site: str,
        describe: Callable[[str, Mapping[str, Any]], Any],
        clock: Clock | None = None,
    ) -> None:
        """Check the settings; nothing is opened yet.

        Raises:
            ConfigError: for an address that cannot be, or that others can reach while there are no keys.
            PortError: for keys that cannot be used, or a libzmq with known holes.
        """
        self._settings = settings
        self._run = run
        self._site = site
        self._describe = describe
        self._clock = Clock() if clock is None else clock
        check_libzmq(zmq.zmq_version_info(), curve=settings.keys is None or zmq.has("curve"))
        self._bound = {
            name: parse_address(f"ports.{name}", getattr(settings, name)) for name in _NAMES if getattr(settings, name)
        }
        if settings.keys is None:
            for name, address in self._bound.items():
                require_keys(f"ports.{name}", address)
        self._engine = None if settings.keys is None else read_pair(settings.keys / f"{ENGINE}.key")
        self._allowed = None if settings.keys is None else AllowList(settings.keys)
        self._intake = Intake()
        self._inbox = Inbox(settings.queue_messages, settings.queue_bytes)
        self._peers = Peers(settings.peer, self._allowed)
        self._context: zmq.Context[Any] | None = None
        self._sockets: dict[str, zmq.Socket[bytes]] = {}
        self._thread: threading.Thread | None = None
        self._stopping = False
        self._failure: BaseException | None = None
        self._errors: Counter[str] = Counter()
        self._waiting = 0
        self._waiting_lock = threading.Lock()
        self._discarded = 0
        self._look_ns = 0
        self._doorkeeper: Doorkeeper | None = None
        self.addresses = Addresses("", "", "", "")

    def start(self) -> Addresses:
        """Bind all ports and begin to serve them.

        Raises:
            PortError: naming the address that cannot be bound, and why.
        """
        self._errands = Errands()
        self._context = zmq.Context()
        try:
            self._open(self._context)
        except BaseException:
            self._close(linger_ms=0)
            raise
        self._thread = threading.Thread(target=self._serve, name="tickfix-ports", daemon=True)
        self._thread.start()
        return self.addresses

    def take(self, timeout_s: float, most: int = 1_000) -> list[Item]:
        """Return what came in, oldest first; wait until something is there or the timeout has passed.

        Raises:
            PortError: when the thread of the ports has ended by itself.
        """
        items = self._inbox.take(timeout_s, most)
        if not items and self._failure is not None:
            raise PortError(f"the ports have stopped: {self._failure!r}") from self._failure
        return items

    def wake(self) -> None:
        """Let :meth:`take` return, though nothing came in; from any thread."""
        self._inbox.wake()

    def answer(self, incoming: Incoming, outcome: Outcome, detail: str = "") -> None:
        """Settle a message: count its outcome, and tell the sender if it wants to know or must know.

        A second answer to the same message is ignored: the first one counts.
        """
        if not self._intake.settle_once(incoming, outcome):
            return
        for body in self._sensors.answer_for(incoming, outcome, detail):
            self._errands.add(partial(self._sensors.send, incoming.peer, body))

    def publish(self, said: Sequence[Said]) -> None:
        """Publish estimates or revisions, in this order."""
        self._in_chunks(said, self._positions.publish)

    def follow(self, records: Sequence[Record]) -> None:
        """Offer records of the journal to engines that follow, in this order."""
        if "follow" in self._bound:
            self._in_chunks(records, self._following.publish)

    def refuse(self, reason: str | None) -> None:
        """From now on answer new devices with ``busy`` and this reason; None lets them in again."""
        self._sensors.doors.new_devices = reason

    def refuse_all(self, reason: str | None) -> None:
        """From now on answer every message with ``busy`` and this reason; None lets them in again."""
        self._sensors.doors.everything = reason

    def forget(self, device: str) -> None:
        """Forget a device that left or expired: its place is free, and its last values are not repeated any more."""
        self._errands.add(partial(self._forget, device))

    def counters(self) -> dict[str, Any]:
        """Return all counters; those of the intake are of one instant, and add up."""
        publications = {
            "sent": self._positions.publisher.sent,
            "sent_bytes": self._positions.publisher.sent_bytes,
            "repeated": self._positions.repeated,
            "stalls": self._positions.publisher.stalls,
            "discarded": self._discarded,
        }
        if "follow" in self._bound:
            publications["followed"] = self._following.publisher.sent
            publications["follow_stalls"] = self._following.publisher.stalls
        messages, n_bytes = self._inbox.waiting
        return {
            "intake": self._intake.snapshot(self._peers),
            "queue": {"messages": messages, "bytes": n_bytes},
            "devices": len(self._sensors.speakers),
            "publications": publications,
            "answers_lost": self._sensors.lost + self._control.lost,
            "control": {"requests": self._control.requests, "refused": self._control.refused},
            "keys": self._key_counters(),
            "errors": dict(self._errors),
        }

    def stop(self) -> None:
        """Send what waits to be sent, close all ports and give their addresses back. Once is enough."""
        if self._thread is None:
            return
        self._stopping = True
        self._errands.add(lambda: None)
        self._thread.join()
        self._thread = None

    def _open(self, context: zmq.Context[Any]) -> None:
        settings, clock = self._settings, self._clock
        if self._allowed is not None:
            doors = self._sockets["zap"] = context.socket(zmq.REP)
            doors.setsockopt(zmq.LINGER, 0)
            doors.bind(ENDPOINT)
            self._doorkeeper = Doorkeeper(doors, self._allowed)
        endpoints = {}
        for name, address in self._bound.items():
            self._sockets[name] = self._opened(context, name)
            endpoints[name] = bind(self._sockets[name], f"ports.{name}", address, private=self._engine is None)
        self.addresses = Addresses(**({"follow": ""} | endpoints))
        self._sensors = Sensors(
            self._sockets["sensors"],
            settings,
            run=self._run,
            site=self._site,
            peers=self._peers,
            intake=self._intake,
            inbox=self._inbox,
            clock=clock,
        )
        self._control = Control(
            self._sockets["control"],
            peers=Peers(_REQUESTS, self._allowed),
            inbox=self._inbox,
            describe=self._told,
            post=self._errands.add,
            clock=clock,
        )
        self._positions = Positions(
            self._sockets["positions"], run=self._run, site=self._site, heartbeat_s=settings.heartbeat_s, clock=clock
        )
        if "follow" in self._sockets:
            self._following = Following(self._sockets["follow"], run=self._run)

    def _opened(self, context: zmq.Context[Any], name: str) -> zmq.Socket[bytes]:
        """Make the socket of a port, not yet bound."""
        # One frame may be twice as long as a message may be, so that the sender of the first too long one is told.
        frame_bytes = {"sensors": 2 * self._settings.message.message_bytes, "control": _REQUEST_BYTES}
        if name in frame_bytes:
            socket = open_router(context, queued=_QUEUED[name], frame_bytes=frame_bytes[name])
        else:
            socket = open_socket(context, zmq.XPUB, queued=_QUEUED[name], frame_bytes=_SUBSCRIPTION_BYTES)
        if self._engine is not None:
            demand_keys(socket, name, self._engine)
        return socket

    def _serve(self) -> None:
        linger_ms = 0
        try:
            self._rounds()
            while self._errands:
                self._errands.run(len(self._errands))
            linger_ms = _LAST_WORDS_MS
        except BaseException as problem:
            self._failure = problem
            raise
        finally:
            self._close(linger_ms)
            self._inbox.close()

    def _rounds(self) -> None:
        """Serve every socket in turn, a little of each, until told to stop."""
        self._watch()
        while not self._stopping:
            ready = dict(self._poller.poll(self._wait_ms()))
            self._guarded(self._run_errands)
            for socket, serve in self._services.items():
                if socket in ready:
                    self._guarded(serve)
            self._guarded(self._positions.repeat)
            self._look()

    def _watch(self) -> None:
        """Have the sockets that are open now polled and served."""
        serves: dict[str, Callable[[], None]] = {
            "positions": self._positions.serve,
            "control": self._control.serve,
            "sensors": self._sensors.serve,
        }
        if "follow" in self._sockets:
            serves["follow"] = self._following.serve
        if self._doorkeeper is not None:
            serves["zap"] = self._doorkeeper.serve
        self._services = {self._sockets[name]: serve for name, serve in serves.items()}
        self._poller = zmq.Poller()
        self._poller.register(self._errands.wake, zmq.POLLIN)
        for socket in self._services:
            self._poller.register(socket, zmq.POLLIN)

    def _wait_ms(self) -> int:
        """Return how long there is nothing to do unless something comes in; ports that pause are not listened to."""
        now_ns = self._clock.monotonic_ns()
        due_ns = [self._positions.beat(len(self._sensors.speakers)), self._look_ns]
        for name, until_ns in (
            ("sensors", self._sensors.closed_until_ns),
            ("control", self._control.closed_until_ns),
        ):
            pauses = until_ns > now_ns
            self._poller.modify(self._sockets[name], 0 if pauses else zmq.POLLIN)
            if pauses:
                due_ns.append(until_ns)
        if (repeats_ns := self._positions.repeats_at_ns) is not None:
            due_ns.append(repeats_ns)
        return 0 if self._errands else max(0, -(-(min(due_ns) - now_ns) // 1_000_000))

    def _look(self) -> None:
        """See now and then whether the allow-list has changed, and cut off listeners that lost their place on it."""
        now_ns = self._clock.monotonic_ns()
        if now_ns < self._look_ns:
            return
        self._look_ns = now_ns + _LOOK_NS
        if self._allowed is None:
            return
        publishers = {"positions": self._positions.publisher}
        if "follow" in self._sockets:
            publishers["follow"] = self._following.publisher
        for name in self._allowed.refresh() & publishers.keys():
            publishers[name].use(self._reopen(name))
            self._watch()

    def _reopen(self, name: str) -> zmq.Socket[bytes]:
        """Close a port and open it again.

        libzmq cannot cut off one connection. This cuts off all; those that may come back do so by themselves, and get
        the last values again.
        """
        assert self._context is not None  # noqa: S101 - for the type checker: the hub is open
        old = self._sockets[name]
        old.unbind(endpoint_of(old))
        old.close(0)
        address = parse_address(f"ports.{name}", getattr(self.addresses, name))
        socket = self._sockets[name] = self._opened(self._context, name)
        for _ in range(_TRIES):
            # The old socket gives its address back on a thread of libzmq's, in a moment.
            with suppress(PortError):
                bind(socket, f"ports.{name}", address, private=False)
                return socket
            time.sleep(_TRY_S)
        bind(socket, f"ports.{name}", address, private=False)
        return socket

    def _run_errands(self) -> None:
        self._errands.run(_ERRANDS)

    def _guarded(self, serve: Callable[[], Any]) -> None:
        try:
            serve()
        except Exception as problem:  # noqa: BLE001 - one port's mishap must not close the others; it is counted
            self._errors[f"{type(problem).__name__}: {problem}"[:200]] += 1

    def _close(self, linger_ms: int) -> None:
        # The doorkeeper was there first and leaves last.
        for socket in reversed(self._sockets.values()):
            # Unbinding first gives the address back at once, though last words may still be on their way.
            with suppress(zmq.ZMQError):
                socket.unbind(endpoint_of(socket))
            socket.close(linger_ms)
        self._sockets.clear()
        if self._context is not None:
            self._context.term()
            self._context = None
        for address in self._bound.values():
            if address.path is not None and self.addresses.sensors:
                address.path.unlink(missing_ok=True)
        self._errands.close()

    def _in_chunks(self, items: Sequence[Any], publish: Callable[[Sequence[Any]], None]) -> None:
        """Have items published a chunk at a time, so that others get their turns in between."""
        with self._waiting_lock:
            room = _WAITING - self._waiting
            taken = items if len(items) <= room else items[:room]
            self._waiting += len(taken)
            self._discarded += len(items) - len(taken)
        for begin in range(0, len(taken), _CHUNK):
            self._errands.add(partial(self._publish_chunk, publish, taken[begin : begin + _CHUNK]))

    def _publish_chunk(self, publish: Callable[[Sequence[Any]], None], chunk: Sequence[Any]) -> None:
        with self._waiting_lock:
            self._waiting -= len(chunk)
        publish(chunk)

    def _forget(self, device: str) -> None:
        self._sensors.speakers.forget(device)
        self._positions.forget(device)

    def _told(self, what: str, args: Mapping[str, Any]) -> Any:
        if what != "subscribe-info":
            return self._describe(what, args)
        return {
            "run": self._run,
            "site": self._site,
            "version": VERSION,
            "oldest_version": OLDEST_VERSION,
            "positions": self.addresses.positions,
            "follow": self.addresses.follow,
            "topics": ["estimate/SITE/FLOOR/DEVICE/PIPELINE", "device/SITE/DEVICE/PIPELINE", "revision/…", "heartbeat"],
            "heartbeat_s": self._settings.heartbeat_s,
        }

    def _key_counters(self) -> dict[str, Any]:
        if self._allowed is None or self._doorkeeper is None:
            return {}
        return {
            "allowed": len(self._allowed),
            "admitted": dict(self._doorkeeper.admitted),
            "refused": dict(self._doorkeeper.refused),
            "problem": self._allowed.problem,
        }
