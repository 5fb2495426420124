"""Single measurements: what an event is made of, in an order of their own that owes nothing to batches or arrival."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from tickfix.api.arrays import Floats
from tickfix.api.events import LATEST_NS, Event, Fix, MotionSamples, Pressure, Scan

Row: TypeAlias = tuple[float, ...]


class Item(NamedTuple):
    """A single measurement: a sensor's row, a scan or a fix."""

    t_ns: int
    stream: str
    content: Any


def explode(event: Event, counts: Counter[str]) -> Iterable[Item]:
    """Yield the single measurements of an event in their order; what is not finite or has no time is counted."""
    if isinstance(event, MotionSamples):
        items = []
        for name, samples in event.sensors.items():
            usable = np.isfinite(samples.values).all(axis=1) & _is_time(samples.t_ns)
            counts["invalid"] += int(len(samples) - usable.sum())
            rows = zip(samples.t_ns[usable].tolist(), rows_of(samples.values[usable]), strict=True)
            items += [Item(t_ns, name, row) for t_ns, row in rows]
        yield from sorted(items)
    elif isinstance(event, Pressure):
        if _is_time(event.t_ns) and np.isfinite(event.pressure_hpa):
            yield Item(event.t_ns, "pressure", (float(event.pressure_hpa) + 0.0,))
        else:
            counts["invalid"] += 1
    elif isinstance(event, Scan):
        usable = np.isfinite(event.rssi_dbm) & (event.heard_ns >= 0) & (event.heard_ns <= event.t_ns)
        counts["invalid readings"] += int(len(event) - usable.sum())
        if not _is_time(event.t_ns) or (len(event) and not usable.any()):
            counts["invalid"] += 1
            return
        if not usable.all():
            heard = tuple(t for t, ok in zip(event.transmitters, usable, strict=True) if ok)
            event = replace(event, transmitters=heard, rssi_dbm=event.rssi_dbm[usable], heard_ns=event.heard_ns[usable])
        yield Item(event.t_ns, f"scan {event.source}", event)
    elif isinstance(event, Fix):
        (a, b), (c, d) = event.covariance.tolist()
        finite = np.isfinite(event.xy).all() and np.isfinite(event.covariance).all()
        if _is_time(event.t_ns) and finite and b == c and a > 0 and a * d - b * c > 0:
            yield Item(event.t_ns, f"fix {event.source}", event)
        else:
            counts["invalid"] += 1


def _is_time(t_ns: Any) -> Any:
    return (t_ns >= 0) & (t_ns <= LATEST_NS)


def rows_of(values: Floats) -> list[Row]:
    """Return the rows (n, c) as tuples, with no negative zero: it would equal the positive one and differ in bits."""
    return [tuple(row) for row in (values + 0.0).tolist()]


def scan_order(scan: Scan) -> tuple[Any, ...]:
    """Return what scans of a device are ordered by; equal for equal scans."""
    # The number of the message is no part of it: a phone that restarts sends its queue again under new numbers.
    return (scan.t_ns, scan.source, scan.transmitters, scan.rssi_dbm.tobytes(), scan.heard_ns.tobytes())


def fix_order(fix: Fix) -> tuple[Any, ...]:
    """Return what fixes of a device are ordered by; equal for equal fixes."""
    return (fix.t_ns, fix.source, fix.floor, fix.xy.tobytes(), fix.covariance.tobytes())
