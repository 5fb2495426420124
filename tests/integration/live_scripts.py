"""Phones as scripts: what each would send and when, so that a test decides what becomes of it on the way."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Self

import msgspec
import numpy as np
import zmq
from live_lab import PATIENCE_S

from tickfix.api import Event, Ints, MotionSamples, Recording, Samples, Scan, Truth
from tickfix.simulation import office_building, simulate_walks
from tickfix.wire import event_to_message

WINDOW = 24
"""Messages that may wait for their answers; an engine keeps 32 for a connection that does not read."""

Clock = Callable[[Ints], Ints]
"""What a device's clock shows, ns, at true times in ns since the script began."""


@dataclass(frozen=True, slots=True)
class Letter:
    """A message under way.

    Attributes:
        at_ns: when it is sent, ns since the script began.
        device, seq: whose it is, and its number.
        body: the message.
        measurements: how many are in it: samples of each sensor count one by one.
        is_scan: it tells of a scan.
    """

    at_ns: int
    device: str
    seq: int
    body: bytes
    measurements: int
    is_scan: bool


@cache
def walks(count: int, length_m: float) -> tuple[Recording, ...]:
    """Return walks through the building that the site of the tests was surveyed in."""
    building = office_building(np.random.default_rng(3), width_m=48.0, height_m=24.0, access_points=12)
    found = simulate_walks(building, "F1", np.random.default_rng(5), count=count, length_m=length_m)
    return tuple(walk.recording for walk in found)


def letters(device: str, walk: Recording, clock: Clock = lambda t_ns: t_ns) -> list[Letter]:
    """Return what a phone with such a clock sends on a walk, in order, numbered from 1."""
    events = sorted((e for e in walk.events if not isinstance(e, Truth)), key=lambda e: e.arrival_ns)
    began_ns = min(_times(event).min() for event in events).item()
    found = []
    for seq, event in enumerate(events, 1):
        told = replace(_clocked(event, began_ns, clock), device=device, session=f"of-{device}", seq=seq)
        t_ns = _times(event)
        found.append(
            Letter(
                at_ns=event.arrival_ns - began_ns,
                device=device,
                seq=seq,
                body=event_to_message(told, ack=True),
                measurements=len(t_ns) if isinstance(event, MotionSamples) else 1,
                is_scan=isinstance(event, Scan),
            )
        )
    return found


def in_turn(*scripts: Iterable[Letter]) -> list[Letter]:
    """Return what several phones send, in the order in which it is sent."""
    return sorted((letter for script in scripts for letter in script), key=lambda letter: letter.at_ns)


@dataclass
class Post:
    """A connection that delivers letters as they are handed to it, and reads what is answered.

    Attributes:
        address: the engine's sensors port.
        outcomes: of the letters of each device.
    """

    address: str
    outcomes: dict[str, Counter[str]] = field(default_factory=dict)
    under_way: int = 0

    def __enter__(self) -> Self:
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._socket = self._context.socket(zmq.DEALER)
        self._socket.linger = 0
        self._socket.rcvtimeo = self._socket.sndtimeo = round(1000 * PATIENCE_S)
        self._socket.connect(self.address)
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()
        self._context.term()

    def deliver(self, script: Iterable[Letter]) -> None:
        """Send letters in the order given, and wait until each was answered."""
        for letter in script:
            self.send(letter)
        while self.under_way:
            self._hear()

    def play(self, script: Iterable[Letter], over: Callable[[], bool] = lambda: False) -> None:
        """Send letters at the pace of the script until it is over, and wait until each was answered."""
        began_ns = time.monotonic_ns()
        for letter in script:
            if over():
                break
            while (wait_ns := began_ns + letter.at_ns - time.monotonic_ns()) > 0:
                if self._socket.poll(wait_ns // 1_000_000 + 1):
                    self._hear()
            self.send(letter)
        while self.under_way:
            self._hear()

    def send(self, letter: Letter) -> None:
        """Send one letter; wait only where too many are under way."""
        while self.under_way >= WINDOW or (self.under_way and self._socket.poll(0)):
            self._hear()
        self._socket.send(letter.body)
        self.under_way += 1

    def leave(self, devices: Iterable[str]) -> None:
        """Say goodbye for devices: their tracks are settled."""
        for device in devices:
            bye = {"v": 1, "type": "bye", "device": device, "session": f"of-{device}", "ack": True}
            self._socket.send(msgspec.msgpack.encode(bye))
            self.under_way += 1
        while self.under_way:
            self._hear()

    def _hear(self) -> None:
        answer = msgspec.msgpack.decode(self._socket.recv_multipart()[-1])
        self.outcomes.setdefault(answer["device"], Counter())[answer["outcome"]] += 1
        self.under_way -= 1


def _times(event: Event) -> Ints:
    if isinstance(event, MotionSamples):
        return np.concatenate([samples.t_ns for samples in event.sensors.values()])
    return np.array([event.t_ns])


def _clocked(event: Event, began_ns: int, clock: Clock) -> Event:
    """Return the event as a device with such a clock would have told it."""
    if isinstance(event, MotionSamples):
        sensors = {name: Samples(clock(s.t_ns - began_ns), s.values) for name, s in event.sensors.items()}
        return MotionSamples(sensors=sensors)
    if isinstance(event, Scan):
        # A phone stamps all readings by the clock that it has when it reports them, also those heard before a step.
        shift_ns = int(clock(_times(event) - began_ns)[0]) - event.t_ns
        return replace(event, heard_ns=event.heard_ns + shift_ns, t_ns=event.t_ns + shift_ns)
    raise TypeError(f"no script has a {type(event).__name__}")
