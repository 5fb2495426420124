"""Plays recordings to an engine as phones would: in the order and at the pace of their logs, one device each."""

from __future__ import annotations

import heapq
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import zmq

from tickfix.api import Event, Fix, MotionSamples, Pressure, Recording, Scan, Truth
from tickfix.client import Keys, Sensor

_ACK_TIMEOUT_S: Final = 60.0
_IDLE_FLUSH_S: Final = 0.02
_POLL_S: Final = 0.25
_REFUSED_OUTCOMES: Final = frozenset({"unauthorised", "malformed", "unknown"})
_MAX_UNACKNOWLEDGED: Final = 2_000
"""Messages of a device that may wait for their acknowledgement before it pauses."""


@dataclass(slots=True)
class SendReport:
    """What became of what was sent.

    Attributes:
        messages: sent for the first time; ``resent`` counts repetitions.
        outcomes: acknowledgements by outcome; ``busy`` and ``throttled`` ones were sent again.
        unknown: messages whose fate is not known.
        refused: why the engine took messages for none of its own, and how many.
        suspected_cause: why none may have come through; empty where all is well.
        max_lag_s: how far sending fell behind the pace, at most.
    """

    messages: int = 0
    resent: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    unknown: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    suspected_cause: str = ""
    max_lag_s: float = 0.0


def send_recordings(
    walks: Mapping[str, Recording],
    address: str,
    *,
    speed: float = 1.0,
    keys: Keys | None = None,
    truth: bool = True,
    skip_bye: bool = False,
    progress: Callable[[str, int, int], None] = lambda *_: None,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> SendReport:
    """Send walks side by side, each under the name of its device.

    Args:
        walks: by device.
        address: the engine's sensors port.
        speed: times faster than they were logged; 0 as fast as the engine takes them.
        truth: send waypoints, too; no tracker sees them.
        skip_bye: do not send ``bye`` at the end of a walk.
        progress: called with the number of messages sent and their total.

    Raises:
        ClientError: for an address that cannot be.
        AccessDeniedError: when the engine does not let this sender in.
    """

    def done(_: int, outcome: str, detail: str) -> None:
        if outcome in _REFUSED_OUTCOMES:
            sent.refused[detail] += 1

    events = {device: _by_arrival(walk.events, truth=truth) for device, walk in walks.items()}
    sent = SendReport()
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    context.set(zmq.MAX_SOCKETS, 3 * len(walks) + 64)
    sensors = {device: Sensor(address, device, keys=keys, context=context, on_outcome=done) for device in walks}
    try:
        for device, sensor in sensors.items():
            sensor.hello(_sensor_rates(walks[device].events), clock="recording")
        _play(events, sensors, sent, speed, progress, clock, sleep)
        for sensor in sensors.values():
            _finish(sensor, clock, skip_bye=skip_bye)
    finally:
        for sensor in sensors.values():
            sent.suspected_cause = sent.suspected_cause or sensor.handshake.suspected_cause
            sent.resent += sensor.resent
            sent.outcomes += sensor.outcomes
            sent.unknown += sensor.close()
        context.term()
    return sent


def _play(
    events: Mapping[str, list[Event]],
    sensors: Mapping[str, Sensor],
    sent: SendReport,
    speed: float,
    progress: Callable[[str, int, int], None],
    clock: Callable[[], float],
    sleep: Callable[[float], None],
) -> None:
    """Send every event when its turn comes; the first of each device without delay."""
    total, began = sum(map(len, events.values())), clock()
    first = {device: queue[0].arrival_ns for device, queue in events.items() if queue}
    pace = 1e-9 / speed if speed > 0 else 0.0
    schedule = [(0.0, device, 0) for device in first]
    heapq.heapify(schedule)
    while schedule:
        due_s, device, n = schedule[0]
        now_s = clock() - began
        if now_s < due_s:
            sleep(min(0.05, due_s - now_s))
            if due_s - now_s > _IDLE_FLUSH_S:  # time to read what was acknowledged, and to send again what was not
                for sensor in sensors.values():
                    sensor.flush(0.0)
            continue
        heapq.heappop(schedule)
        sent.max_lag_s = max(sent.max_lag_s, now_s - due_s if speed > 0 else 0.0)
        sensor, queue = sensors[device], events[device]
        while sensor.unacknowledged > _MAX_UNACKNOWLEDGED:
            sensor.flush(0.05)
            sensor.handshake.raise_if_denied()
        _send_event(sensor, queue[n])
        sent.messages += 1
        progress("sending", sent.messages, total)
        if n + 1 < len(queue):
            heapq.heappush(schedule, ((queue[n + 1].arrival_ns - first[device]) * pace, device, n + 1))


def _finish(sensor: Sensor, clock: Callable[[], float], *, skip_bye: bool) -> None:
    """Wait until all was acknowledged, then send ``bye``; stop when nothing is acknowledged for a long time."""
    until_s, waiting = clock() + _ACK_TIMEOUT_S, sensor.unacknowledged
    while not (sensor.flush(_POLL_S) if skip_bye else sensor.bye(_POLL_S)) and clock() < until_s:
        sensor.handshake.raise_if_denied()
        if sensor.unacknowledged != waiting:
            until_s, waiting = clock() + _ACK_TIMEOUT_S, sensor.unacknowledged


def _by_arrival(events: Sequence[Event], *, truth: bool) -> list[Event]:
    return sorted((e for e in events if truth or not isinstance(e, Truth)), key=lambda e: e.arrival_ns)


def _sensor_rates(events: Sequence[Event]) -> dict[str, float]:
    """Return the mean rate of each motion sensor in Hz."""
    counts: Counter[str] = Counter()
    ends: dict[str, tuple[int, int]] = {}
    for event in events:
        if isinstance(event, MotionSamples):
            for name, samples in event.sensors.items():
                if len(samples):
                    low, high = ends.get(name, (int(samples.t_ns[0]), int(samples.t_ns[0])))
                    ends[name] = min(low, int(samples.t_ns.min())), max(high, int(samples.t_ns.max()))
                    counts[name] += len(samples)
    return {name: (n - 1) / max(1e-9, (ends[name][1] - ends[name][0]) * 1e-9) for name, n in counts.items()}


def _send_event(sensor: Sensor, event: Event) -> None:
    if isinstance(event, MotionSamples):
        sensor.motion({name: (s.t_ns, s.values) for name, s in event.sensors.items()})
    elif isinstance(event, Scan):
        scanned = list(event.transmitters)
        sensor.scan(scanned, event.rssi_dbm, event.heard_ns, t_ns=event.t_ns, source=event.source, values=event.values)
    elif isinstance(event, Pressure):
        sensor.pressure(event.t_ns, event.pressure_hpa)
    elif isinstance(event, Fix):
        sensor.fix(event.t_ns, event.floor, event.xy, covariance=event.covariance, source=event.source)
    else:
        sensor.truth(event.t_ns, event.floor, event.xy)
