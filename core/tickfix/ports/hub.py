"""All ports of an engine, on one thread of their own."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import zmq

from tickfix.api.errors import PortError
from tickfix.kernel import Outcome
from tickfix.ports.authentication import AllowList, Doorkeeper
from tickfix.ports.backlog import Backlog
from tickfix.ports.clock import Clock
from tickfix.ports.control import Control
from tickfix.ports.following import Following, Record
from tickfix.ports.intake import Inbox, Incoming, Intake, Item
from tickfix.ports.opening import OpenPorts
from tickfix.ports.peers import Peers
from tickfix.ports.positions import Positions, Said
from tickfix.ports.rounds import Rounds
from tickfix.ports.sensors import Sensors
from tickfix.ports.settings import PeerLimits, PortSettings
from tickfix.ports.sockets import check_libzmq
from tickfix.ports.waking import Errands
from tickfix.wire import OLDEST_VERSION, VERSION

_REQUESTS: Final = PeerLimits(messages_per_s=100.0, message_burst=200, bytes_per_s=2**20, byte_burst=2**22)
_LAST_WORDS_MS: Final = 5_000


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
        check_libzmq(zmq.zmq_version_info(), curve=settings.keys is None or zmq.has("curve"))
        self._settings = settings
        self._run = run
        self._site = site
        self._describe = describe
        self._clock = Clock() if clock is None else clock
        self._ports = OpenPorts(settings)
        self._allowed = None if settings.keys is None else AllowList(settings.keys)
        self._intake = Intake()
        self._inbox = Inbox(settings.queue_messages, settings.queue_bytes)
        self._peers = Peers(settings.peer, self._allowed)
        self._thread: threading.Thread | None = None
        self._stopping = False
        self._failure: BaseException | None = None
        self._doorkeeper: Doorkeeper | None = None
        self._following: Following | None = None
        self.addresses = Addresses("", "", "", "")

    def start(self) -> Addresses:
        """Bind all ports and begin to serve them.

        Raises:
            PortError: naming the address that cannot be bound, and why.
        """
        self._ports.open()
        self.addresses = Addresses(**({"follow": ""} | self._ports.endpoints))
        self._errands = Errands()
        self._backlog = Backlog(self._errands)
        self._attend()
        self._rounds = Rounds(
            self._ports,
            self._errands,
            sensors=self._sensors,
            control=self._control,
            positions=self._positions,
            following=self._following,
            doorkeeper=self._doorkeeper,
            allowed=self._allowed,
            clock=self._clock,
        )
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
        self._backlog.add(said, self._positions.publish)

    def follow(self, records: Sequence[Record]) -> None:
        """Offer records of the journal to engines that follow, in this order."""
        if self._following is not None:
            self._backlog.add(records, self._following.publish)

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
            "discarded": self._backlog.discarded,
        }
        if self._following is not None:
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
            "errors": dict(self._rounds.errors),
        }

    def stop(self) -> None:
        """Send what waits to be sent, close all ports and give their addresses back. Once is enough."""
        if self._thread is None:
            return
        self._stopping = True
        self._errands.add(lambda: None)
        self._thread.join()
        self._thread = None

    def _attend(self) -> None:
        """Put someone behind every socket."""
        settings, clock, ports = self._settings, self._clock, self._ports
        self._sensors = Sensors(
            ports["sensors"],
            settings,
            run=self._run,
            site=self._site,
            peers=self._peers,
            intake=self._intake,
            inbox=self._inbox,
            clock=clock,
        )
        self._control = Control(
            ports["control"],
            peers=Peers(_REQUESTS, self._allowed),
            inbox=self._inbox,
            describe=self._told,
            post=self._errands.add,
            clock=clock,
        )
        self._positions = Positions(
            ports["positions"], run=self._run, site=self._site, heartbeat_s=settings.heartbeat_s, clock=clock
        )
        if "follow" in ports:
            self._following = Following(ports["follow"], run=self._run)
        if self._allowed is not None:
            self._doorkeeper = Doorkeeper(ports["doorkeeper"], self._allowed)

    def _serve(self) -> None:
        linger_ms = 0
        try:
            self._rounds.serve(lambda: self._stopping)
            linger_ms = _LAST_WORDS_MS
        except BaseException as problem:
            self._failure = problem
            raise
        finally:
            self._ports.close(linger_ms)
            self._errands.close()
            self._inbox.close()

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
