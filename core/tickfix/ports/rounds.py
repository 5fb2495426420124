"""The work of the one thread that touches sockets: rounds over all of them, a little of each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any, Final

import zmq

from tickfix.ports.authentication import AllowList, Doorkeeper
from tickfix.ports.clock import Clock
from tickfix.ports.control import Control
from tickfix.ports.following import Following
from tickfix.ports.opening import OpenPorts
from tickfix.ports.positions import Positions
from tickfix.ports.sensors import Sensors
from tickfix.ports.waking import Errands

_ERRANDS: Final = 32
_LOOK_NS: Final = 500_000_000
_ROUND_NS: Final = 1_000_000
"""Where nothing is left to do, rounds begin no closer: waking for every message would cost more than serving it."""


class Rounds:
    """Waits for sockets, errands and times that are due, and serves each a little.

    Attributes:
        errors: mishaps of single ports, by what they were; they should not happen, and close nothing.
    """

    def __init__(
        self,
        ports: OpenPorts,
        errands: Errands,
        *,
        sensors: Sensors,
        control: Control,
        positions: Positions,
        following: Following | None,
        doorkeeper: Doorkeeper | None,
        allowed: AllowList | None,
        clock: Clock,
    ) -> None:
        """Prepare to serve these."""
        self._ports = ports
        self._errands = errands
        self._sensors = sensors
        self._control = control
        self._positions = positions
        self._following = following
        self._doorkeeper = doorkeeper
        self._allowed = allowed
        self._clock = clock
        self._look_ns = 0
        self.errors: Counter[str] = Counter()
        self._watch()

    def serve(self, ended: Callable[[], bool]) -> None:
        """Go round until ``ended``, then run the errands that are left."""
        while not ended():
            ready = dict(self._poller.poll(self._wait_ms()))
            begun_ns = self._clock.monotonic_ns()
            # First what the loop said, so that it counts for what comes in now.
            self._guarded(self._run_errands)
            more = False
            for socket, serve in self._services.items():
                if socket in ready:
                    more = self._guarded(serve) is True or more
            self._guarded(self._positions.repeat)
            self._look()
            left_ns = begun_ns + _ROUND_NS - self._clock.monotonic_ns()
            if left_ns > 0 and not more and not self._errands:
                self._clock.sleep(left_ns * 1e-9)
        while self._errands:
            self._guarded(self._run_errands)

    def _watch(self) -> None:
        """Have the sockets that are open now polled and served."""
        serves: dict[str, Callable[[], Any]] = {
            "positions": self._positions.serve,
            "control": self._control.serve,
            "sensors": self._sensors.serve,
        }
        if self._following is not None:
            serves["follow"] = self._following.serve
        if self._doorkeeper is not None:
            serves["doorkeeper"] = self._doorkeeper.serve
        self._services = {self._ports[name]: serve for name, serve in serves.items()}
        self._poller = zmq.Poller()
        self._poller.register(self._errands.wake, zmq.POLLIN)
        for socket in self._services:
            self._poller.register(socket, zmq.POLLIN)
        self._paused: set[str] = set()

    def _wait_ms(self) -> int:
        """Return how long there is nothing to do unless something comes in; ports that pause are not listened to."""
        now_ns = self._clock.monotonic_ns()
        due_ns = [self._positions.beat(len(self._sensors.speakers)), self._look_ns]
        for name, until_ns in (
            ("sensors", self._sensors.closed_until_ns),
            ("control", self._control.closed_until_ns),
        ):
            pauses = until_ns > now_ns
            if pauses is not (name in self._paused):
                self._poller.modify(self._ports[name], 0 if pauses else zmq.POLLIN)
                self._paused ^= {name}
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
        if self._following is not None:
            publishers["follow"] = self._following.publisher
        self._allowed.refresh()
        for name in self._allowed.take_lost() & publishers.keys():
            publishers[name].use(self._ports.reopen(name))
            self._watch()

    def _run_errands(self) -> None:
        self._errands.run(_ERRANDS)

    def _guarded(self, serve: Callable[[], Any]) -> Any:
        try:
            return serve()
        except Exception as problem:  # noqa: BLE001 - one port's mishap must not close the others; it is counted
            self.errors[f"{type(problem).__name__}: {problem}"[:200]] += 1
            return None
