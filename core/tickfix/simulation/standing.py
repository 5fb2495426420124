"""Surveys that stand still at their points: one recording a point."""

from __future__ import annotations

import numpy as np

from tickfix.api import Recording, Rng, Truth
from tickfix.simulation.building import Building
from tickfix.simulation.recording import START_NS, Logging, scan_events
from tickfix.simulation.scanning import Receiver, scan
from tickfix.simulation.walker import Trajectory

_RATE_HZ = 5.0


def simulate_stand(
    building: Building,
    floor: str,
    xy: tuple[float, float],
    rng: Rng,
    *,
    name: str,
    seconds: float,
    heading_rad: float = 0.0,
    receiver: Receiver | None = None,
    logging: Logging | None = None,
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
        way_m=np.zeros(n),
        xy=np.broadcast_to(np.asarray(xy, dtype=np.float64), (n, 2)),
        heading_rad=np.full(n, heading_rad),
        speed_mps=np.zeros(n),
        phase=np.zeros(n),
        swing_mps2=np.zeros(n),
    )
    heard = scan(trajectory, building.floor(floor), building.radio, receiver or Receiver(), scan_rng)
    names = [ap.name for ap in building.access_points]
    scans = scan_events(heard, names, name, start_ns, logging or Logging(), log_rng)
    end_ns = start_ns + round(seconds * 1e9)
    taps = [Truth(t_ns=t, floor=floor, xy=np.array(xy), device=name, arrival_ns=t) for t in (start_ns, end_ns)]
    return Recording(name=name, floor=floor, events=(*scans, *taps))
