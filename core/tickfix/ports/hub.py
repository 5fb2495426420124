"""All ports of an engine, on one thread of their own."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any, Final

import zmq

from tickfix.api import Source
from tickfix.api.errors import PortError
from tickfix.ports.authentication import AllowList, ZapAuthenticator
from tickfix.ports.control_port import ControlPort
from tickfix.ports.inbound_queue import InboundItem, InboundMessage, InboundQueue, IntakeCounters
from tickfix.ports.io_thread import CallQueue, IoLoop, PublicationBacklog
from tickfix.ports.peers import PeerRegistry
from tickfix.ports.port_settings import Clock, PeerLimits, PortSettings
from tickfix.ports.publishers import FollowPort, FollowRecord, PositionsPort, Publication
from tickfix.ports.sensors_port import SensorsPort
from tickfix.ports.sockets import PortSockets, check_libzmq
from tickfix.wire import OLDEST_VERSION, VERSION, ReplyOutcome

_CONTROL_LIMITS: Final = PeerLimits(messages_per_s=100.0, message_burst=200, bytes_per_s=2**20, byte_burst=2**22)
_CLOSE_LINGER_MS: Final = 5_000


@dataclass(frozen=True, slots=True)
class PortAddresses:
    """Where the ports are, in full; ``follow`` is empty when nobody can follow."""

    sensors: str
    positions: str
    control: str
    follow: str


class Hub:
    """All sockets of an engine, and the one thread that touches them.

    The loop takes what came in with :meth:`take` and owes each :class:`InboundMessage` one :meth:`answer`, and each
    :class:`ControlCommand` one reply; everything else here may be called from any thread and returns at once.

    ``describe(what, args)`` is called on the hub's thread for every request but ``drain``, ``stop`` and ``primary``
    (those come out of :meth:`take` as :class:`ControlCommand`) and ``subscribe_info`` (answered here). It must be
    quick and safe from a foreign thread, and return what MessagePack can hold, or :data:`ASK_LOOP`: then the query
    comes out of :meth:`take` as a :class:`ControlCommand`, too. What it raises is reported to the requester.
    ``tickfix status`` shows the answer to ``status``, a plain dict::

        {
          "run": str, "site": str, "uptime_s": float,
          "devices": int,                                   # devices followed now
          "ticks": int,                                     # ticks closed since the run began
          "tick_latency_ms": {"p50": float, "p99": float, "max": float},     # after a tick's deadline
          "round_duration_ms": {"p50": float, "p99": float, "max": float},   # per round of the loop
          "intake": {outcome: int, ...},                    # hub.counters()["intake"]["outcomes"]
          "measurements": {outcome: int, ...},              # of single samples and readings, by the kernel
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
        sources: Mapping[str, Source] = MappingProxyType({}),
    ) -> None:
        """Check the settings; nothing is opened yet. ``sources`` are those whose columns are checked.

        Raises:
            ConfigError: for an address that cannot be, or that others can reach while there are no keys.
            PortError: for keys that cannot be used, or a libzmq with known holes.
        """
        check_libzmq(zmq.zmq_version_info(), curve=settings.keys is None or zmq.has("curve"))
        self._settings = settings
        self._run = run
        self._site = site
        self._describe = describe
        self._sources = sources
        self._clock = Clock() if clock is None else clock
        self._ports = PortSockets(settings)
        self._allowed = None if settings.keys is None else AllowList(settings.keys)
        self._intake = IntakeCounters()
        self._inbound_queue = InboundQueue(settings.queue_messages, settings.queue_bytes)
        self._peers = PeerRegistry(settings.peer, self._allowed)
        self._thread: threading.Thread | None = None
        self._stopping = False
        self._failure: BaseException | None = None
        self._authenticator: ZapAuthenticator | None = None
        self._follow_port: FollowPort | None = None
        self.addresses = PortAddresses("", "", "", "")

    def start(self) -> PortAddresses:
        """Bind all ports and begin to serve them.

        Raises:
            PortError: naming the address that cannot be bound, and why.
        """
        self._ports.open()
        self.addresses = PortAddresses(**({"follow": ""} | self._ports.endpoints))
        self._call_queue = CallQueue()
        self._publication_backlog = PublicationBacklog(self._call_queue)
        self._create_ports()
        self._io_loop = IoLoop(
            self._ports,
            self._call_queue,
            sensors=self._sensors,
            control=self._control,
            positions=self._positions,
            following=self._follow_port,
            authenticator=self._authenticator,
            allowed=self._allowed,
            clock=self._clock,
        )
        self._thread = threading.Thread(target=self._serve, name="tickfix-ports", daemon=True)
        self._thread.start()
        return self.addresses

    def take(self, timeout_s: float, max_items: int = 1_000) -> list[InboundItem]:
        """Return what came in, oldest first; wait until something is there or the timeout has passed.

        Raises:
            PortError: when the thread of the ports has ended by itself.
        """
        items = self._inbound_queue.take(timeout_s, max_items)
        if not items and self._failure is not None:
            raise PortError(f"the ports have stopped: {self._failure!r}") from self._failure
        return items

    def wake(self) -> None:
        """Let :meth:`take` return, though nothing came in; from any thread."""
        self._inbound_queue.wake()

    def answer(self, incoming: InboundMessage, outcome: ReplyOutcome, detail: str = "") -> None:
        """Settle a message: count its outcome, and tell the sender if it wants to know or must know.

        A second answer to the same message is ignored: the first one counts.
        """
        if not self._intake.count_outcome_once(incoming, outcome):
            return
        for body in self._sensors.replies_for(incoming, outcome, detail):
            self._call_queue.add(partial(self._sensors.send, incoming.peer, body))

    def publish(self, publications: Sequence[Publication]) -> None:
        """Publish estimates or revisions, in this order."""
        self._publication_backlog.add(publications, self._positions.publish)

    def follow(self, records: Sequence[FollowRecord]) -> None:
        """Offer records of the journal to engines that follow, in this order."""
        if self._follow_port is not None:
            self._publication_backlog.add(records, self._follow_port.publish)

    def reject_new_devices(self, reason: str | None) -> None:
        """From now on answer new devices with ``busy`` and this reason; None lets them in again."""
        self._sensors.admission.new_devices = reason

    def reject_all_messages(self, reason: str | None) -> None:
        """From now on answer every message with ``busy`` and this reason; None lets them in again."""
        self._sensors.admission.all_messages = reason

    def forget(self, device: str) -> None:
        """Forget a device that left or expired: its place is free, and its last values are not repeated any more."""
        self._call_queue.add(partial(self._forget, device))

    def counters(self) -> dict[str, Any]:
        """Return all counters; those of the intake are of one instant, and add up."""
        publications = {
            "sent": self._positions.publisher.sent,
            "sent_bytes": self._positions.publisher.sent_bytes,
            "last_values_sent": self._positions.last_values_sent,
            "stalls": self._positions.publisher.stalls,
            "discarded": self._publication_backlog.discarded,
        }
        if self._follow_port is not None:
            publications["follow_sent"] = self._follow_port.publisher.sent
            publications["follow_stalls"] = self._follow_port.publisher.stalls
        messages, n_bytes = self._inbound_queue.waiting
        return {
            "intake": self._intake.snapshot(self._peers),
            "queue": {"messages": messages, "bytes": n_bytes},
            "devices": len(self._sensors.device_sessions),
            "publications": publications,
            "replies_lost": self._sensors.replies_lost + self._control.replies_lost,
            "control": {"requests": self._control.requests, "refused": self._control.refused},
            "keys": self._key_counters(),
            "errors": dict(self._io_loop.errors),
        }

    def stop(self) -> None:
        """Send what waits to be sent, close all ports and give their addresses back. Once is enough."""
        if self._thread is None:
            return
        self._stopping = True
        self._call_queue.add(lambda: None)
        self._thread.join()
        self._thread = None

    def _create_ports(self) -> None:
        """Put someone behind every socket."""
        settings, clock, ports = self._settings, self._clock, self._ports
        self._sensors = SensorsPort(
            ports["sensors"],
            settings,
            run=self._run,
            site=self._site,
            peers=self._peers,
            intake=self._intake,
            inbound_queue=self._inbound_queue,
            clock=clock,
            sources=self._sources,
        )
        self._control = ControlPort(
            ports["control"],
            peers=PeerRegistry(_CONTROL_LIMITS, self._allowed),
            inbound_queue=self._inbound_queue,
            describe=self._describe_request,
            post=self._call_queue.add,
            clock=clock,
        )
        self._positions = PositionsPort(
            ports["positions"], run=self._run, site=self._site, heartbeat_s=settings.heartbeat_s, clock=clock
        )
        if "follow" in ports:
            self._follow_port = FollowPort(ports["follow"], run=self._run)
        if self._allowed is not None:
            self._authenticator = ZapAuthenticator(ports["authenticator"], self._allowed)

    def _serve(self) -> None:
        linger_ms = 0
        try:
            self._io_loop.serve(lambda: self._stopping)
            linger_ms = _CLOSE_LINGER_MS
        except BaseException as error:
            self._failure = error
            raise
        finally:
            self._ports.close(linger_ms)
            self._call_queue.close()
            self._inbound_queue.close()

    def _forget(self, device: str) -> None:
        self._sensors.device_sessions.forget(device)
        self._positions.forget(device)

    def _describe_request(self, what: str, args: Mapping[str, Any]) -> Any:
        if what != "subscribe_info":
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
        if self._allowed is None or self._authenticator is None:
            return {}
        return {
            "allowed": len(self._allowed),
            "admitted": dict(self._authenticator.admitted),
            "refused": dict(self._authenticator.refused),
            "allow_list_error": self._allowed.error,
        }
