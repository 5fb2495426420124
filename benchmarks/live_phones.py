"""The phones of ``live.py``: what each sends, when it is due to leave, and a process that sends it."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import zmq

from tickfix.api import TICK_NS, MotionSamples, Recording, Samples, Scan
from tickfix.wire import event_to_message

PER_CONNECTION = 150
"""Phones behind one connection: 5.4 messages a second each, and an engine takes 1000 a second from a connection."""
CUT_NS = 30_000_000
"""How long after a tick the batch that closes it ends: by then every sensor has passed it."""
ONE_IN, BEHIND = 20, 7
"""One scan in so many is late, by so many batches."""
NAME = b"phone-0000"


@dataclass(frozen=True)
class Script:
    """What a phone that walks one walk sends, batch by batch; whoever sends puts its own name in place of NAME.

    Attributes:
        first: the tick that the first batch closes.
        batches: a message for every tick.
        scans: those that leave with each batch, numbered.
    """

    first: int
    batches: list[bytes]
    scans: list[list[tuple[int, bytes]]]


def script_of(recording: Recording) -> Script:
    """Cut a recording into batches of one tick."""
    motion = [e for e in recording.events if isinstance(e, MotionSamples)]
    streams = {
        name: (
            np.concatenate([e.sensors[name].t_ns for e in motion if name in e.sensors]),
            np.concatenate([e.sensors[name].values for e in motion if name in e.sensors]),
        )
        for name in sorted({name for e in motion for name in e.sensors})
    }
    first = max(int(t_ns[0]) for t_ns, _ in streams.values()) // TICK_NS + 2
    last = min(int(t_ns[-1]) - CUT_NS for t_ns, _ in streams.values()) // TICK_NS
    batches, scans = [], []
    waiting = sorted((e for e in recording.events if isinstance(e, Scan)), key=lambda e: e.arrival_ns)
    number = seq = 0
    device = NAME.decode()
    for tick in range(first, last + 1):
        ends_ns = tick * TICK_NS + CUT_NS
        leaving = []
        while waiting and waiting[0].arrival_ns <= ends_ns:
            seq, number = seq + 1, number + 1
            scan = replace(waiting.pop(0), device=device, session="benchmark", seq=seq)
            leaving.append((number, event_to_message(scan)))
        scans.append(leaving)
        sensors = {}
        for name, (t_ns, values) in streams.items():
            begin, end = np.searchsorted(t_ns, [ends_ns - TICK_NS, ends_ns], side="right")
            sensors[name] = Samples(t_ns[begin:end], values[begin:end])
        seq += 1
        batches.append(event_to_message(MotionSamples(sensors=sensors, device=device, session="benchmark", seq=seq)))
    return Script(first, batches, scans)


def name_of(device: int) -> bytes:
    """Return a phone's name, as long as all names."""
    return b"phone-%04d" % device


def begin_of(device: int) -> int:
    """Return the batch with which a phone begins: no two do the same at the same time."""
    return 7 * device % 100


def due_ns(t0_ns: int, n: int, device: int, devices: int) -> int:
    """Return when batch ``n`` of a run that began at ``t0_ns`` is due to leave: devices take turns within a tick."""
    return t0_ns + n * TICK_NS + device * TICK_NS // devices


def send(address: str, scripts: list[Script], devices: int, n_batches: int, t0_ns: int, said: Any) -> None:
    """Send all that is due, when it is due; in a process of its own."""
    context = zmq.Context()
    sockets = []
    for _ in range(-(-devices // PER_CONNECTION)):
        socket = context.socket(zmq.DEALER)
        socket.setsockopt(zmq.SNDHWM, 0)
        socket.connect(address)
        sockets.append(socket)
    phones = [
        (name_of(d), scripts[d % len(scripts)], begin_of(d), sockets[d // PER_CONNECTION]) for d in range(devices)
    ]
    late_ns = 0
    for n in range(n_batches):
        for device, (name, script, begin, socket) in enumerate(phones):
            at_ns = due_ns(t0_ns, n, device, devices)
            while (left_ns := at_ns - time.monotonic_ns()) > 0:
                time.sleep(left_ns * 1e-9)
            late_ns = max(late_ns, -left_ns)
            at = begin + n
            for scan, body in script.scans[at]:
                if (scan + device) % ONE_IN:
                    socket.send(body.replace(NAME, name, 1))
            for scan, body in script.scans[at - BEHIND] if n >= BEHIND else ():
                if (scan + device) % ONE_IN == 0:
                    socket.send(body.replace(NAME, name, 1))
            socket.send(script.batches[at].replace(NAME, name, 1))
    said.put(late_ns)
    context.destroy(linger=10_000)
