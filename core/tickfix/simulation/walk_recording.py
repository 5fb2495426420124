"""Simulated recordings as a reader would return them.

A walk from the first sample to the last, and stationary scans at a survey point.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from tickfix.api import Event, Floats, Ints, MotionSamples, Recording, Rng, Samples, Scan, Truth
from tickfix.simulation.building import Building
from tickfix.simulation.pedestrian import Trajectory, TrueSteps, Walker, walk_route
from tickfix.simulation.phone_sensors import Phone, simulate_motion_sensors
from tickfix.simulation.radio_channel import Receiver, SimulatedScan, simulate_scans
from tickfix.simulation.routes import Route

START_NS: Final = 1_700_000_000_000_000_000
"""Default start of simulated recordings."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggingSettings:
    """How samples become messages.

    Attributes:
        batch_s: motion samples of so long make one message.
        latency_s: shortest and longest time from sending to arrival; messages may overtake each other.
        waypoint_m: the surveyor taps at the start, at the end, and so far apart on the way.
        tap_s: shortest and longest time from a tap to its being logged.
    """

    batch_s: float = 0.1
    latency_s: tuple[float, float] = (0.005, 0.03)
    waypoint_m: float = 6.0
    tap_s: tuple[float, float] = (0.05, 0.3)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SimulatedWalk:
    """A recording with all that no real one has.

    Attributes:
        recording: what a reader would have given.
        t_ns: (n,) int64, the trajectory's instants on the device's clock.
        trajectory: where the person truly was, at 200 Hz.
        steps: the true steps; their times count from ``t_ns[0]``.
        scans: when the phone listened, in seconds since ``t_ns[0]``.
    """

    recording: Recording
    t_ns: Ints
    trajectory: Trajectory
    steps: TrueSteps
    scans: tuple[SimulatedScan, ...]


def simulate_walk(
    building: Building,
    route: Route,
    rng: Rng,
    *,
    name: str,
    walker: Walker | None = None,
    phone: Phone | None = None,
    receiver: Receiver | None = None,
    logging: LoggingSettings | None = None,
    start_ns: int = START_NS,
) -> SimulatedWalk:
    """Walk a route with a phone in the hand.

    Args:
        building: where.
        route: its floor is the floor of the recording.
        rng: walking, motion sensors, Wi-Fi and logging draw from four streams of it: another phone on the same seed
            is carried along the very same walk.
        name: of the recording, and of the device.
        walker, phone, receiver, logging: settings, the defaults where not given.
        start_ns: device time at which the recording begins.
    """
    walk_rng, motion_rng, radio_rng, log_rng = rng.spawn(4)
    walker, log = walker or Walker(), logging or LoggingSettings()
    floor = building.floor(route.floor)
    trajectory, steps = walk_route(route, walker, walk_rng)
    level_m = floor.level * building.radio.settings.floor_height_m
    t, samples = simulate_motion_sensors(
        trajectory, level_m, building.magnetic, phone or Phone(), walker.hold, motion_rng
    )
    scans = simulate_scans(trajectory, floor, building.radio, receiver or Receiver(), radio_rng)
    motion_log, scan_log, tap_log = log_rng.spawn(3)
    sent = _sorted_by_arrival(
        [
            *_batches(_ns(t, start_ns), samples, name, start_ns, log, motion_log),
            *scan_events(scans, [ap.name for ap in building.access_points], name, start_ns, log, scan_log),
        ]
    )
    taps = _sorted_by_arrival(_waypoint_taps(trajectory, route.floor, name, start_ns, log, tap_log))
    # Taps count on after the phone's own messages, so that leaving the truth out leaves no gap.
    events = [replace(event, seq=seq) for seq, event in enumerate([*sent, *taps])]
    recording = Recording(name=name, floor=route.floor, events=tuple(_sorted_by_arrival(events)))
    return SimulatedWalk(
        recording=recording, t_ns=_ns(trajectory.t_s, start_ns), trajectory=trajectory, steps=steps, scans=scans
    )


def _sorted_by_arrival(events: Sequence[Event]) -> list[Event]:
    return sorted(events, key=lambda event: (event.arrival_ns, event.t_ns))


def _ns(t_s: Floats | float, start_ns: int) -> Ints:
    ns: Ints = start_ns + np.rint(t_s * 1e9).astype(np.int64)
    return ns


def _delayed(t_ns: int, span_s: tuple[float, float], rng: Rng) -> int:
    return t_ns + round(rng.uniform(*span_s) * 1e9)


def _batches(
    t_ns: Ints, samples: Mapping[str, Floats], name: str, start_ns: int, log: LoggingSettings, rng: Rng
) -> list[MotionSamples]:
    batch_ns = round(log.batch_s * 1e9)
    number = (t_ns - start_ns) // batch_ns
    cuts = np.flatnonzero(np.diff(number, prepend=-1, append=-1))
    return [
        MotionSamples(
            sensors={sensor: Samples(t_ns[a:b], values[a:b]) for sensor, values in samples.items()},
            device=name,
            arrival_ns=_delayed(start_ns + int(number[a] + 1) * batch_ns, log.latency_s, rng),
        )
        for a, b in pairwise(cuts.tolist())
    ]


def scan_events(
    scans: Sequence[SimulatedScan], names: Sequence[str], device: str, start_ns: int, log: LoggingSettings, rng: Rng
) -> list[Scan]:
    """Return what a phone heard as the scans it sends.

    Args:
        scans: times count from ``start_ns``.
        names: of the access points, by their numbers.
        device: that heard.
        start_ns: device time at which the recording begins.
        log, rng: how and by which draws they are logged.
    """
    return [
        Scan(
            transmitters=tuple(names[i] for i in heard.access_point),
            rssi_dbm=heard.rssi_dbm,
            heard_ns=_ns(heard.heard_s, start_ns),
            t_ns=int(_ns(np.max(heard.heard_s, initial=heard.begin_s), start_ns)),
            device=device,
            arrival_ns=_delayed(int(_ns(heard.delivered_s, start_ns)), log.latency_s, rng),
        )
        for heard in scans
    ]


def _waypoint_taps(
    trajectory: Trajectory, floor: str, name: str, start_ns: int, log: LoggingSettings, rng: Rng
) -> list[Truth]:
    total = float(trajectory.distance_m[-1])
    distance = np.linspace(0.0, total, max(1, round(total / log.waypoint_m)) + 1)
    # The way stands still in pauses: a tap in one is made on arriving, the first one before setting off.
    t = trajectory.t_s[np.minimum(np.searchsorted(trajectory.distance_m, distance), len(trajectory.t_s) - 1)]
    return [
        Truth(t_ns=int(ns), floor=floor, xy=xy, device=name, arrival_ns=_delayed(int(ns), log.tap_s, rng))
        for ns, xy in zip(_ns(t, start_ns), trajectory.xy_at(t), strict=True)
    ]


_RATE_HZ = 5.0


def simulate_stationary_scans(
    building: Building,
    floor: str,
    xy: tuple[float, float],
    rng: Rng,
    *,
    name: str,
    seconds: float,
    heading_rad: float = 0.0,
    receiver: Receiver | None = None,
    logging: LoggingSettings | None = None,
    start_ns: int = START_NS,
) -> Recording:
    """Stand at a place and scan, nothing else: a tap in the beginning, a tap in the end, and no motion sensors.

    Args:
        building, floor, xy: where, metres in the floor's frame.
        rng: draws the scans and how they are logged.
        name: of the recording, and of the device.
        seconds: how long.
        heading_rad: where the person looks, clockwise from +y.
        receiver, logging: settings, the defaults where not given.
        start_ns: device time of the first tap.
    """
    scan_rng, log_rng = rng.spawn(2)
    n = int(np.ceil(seconds * _RATE_HZ)) + 1
    trajectory = Trajectory(
        t_s=np.linspace(0.0, seconds, n),
        distance_m=np.zeros(n),
        xy=np.broadcast_to(np.asarray(xy, dtype=np.float64), (n, 2)),
        heading_rad=np.full(n, heading_rad),
        speed_mps=np.zeros(n),
        phase=np.zeros(n),
        swing_mps2=np.zeros(n),
    )
    heard = simulate_scans(trajectory, building.floor(floor), building.radio, receiver or Receiver(), scan_rng)
    names = [ap.name for ap in building.access_points]
    scans = scan_events(heard, names, name, start_ns, logging or LoggingSettings(), log_rng)
    end_ns = start_ns + round(seconds * 1e9)
    taps = [Truth(t_ns=t, floor=floor, xy=np.array(xy), device=name, arrival_ns=t) for t in (start_ns, end_ns)]
    return Recording(name=name, floor=floor, events=(*scans, *taps))
