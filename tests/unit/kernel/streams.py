"""Events of one phone in a few words, and what the kernel said about them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from lab import Folded, fold
from toys import toy_pipeline

from tickfix.api import Estimate, Event, MotionSamples, Scan, motion_samples
from tickfix.kernel import KernelSettings

S = 1_000_000_000
MS = 1_000_000
T0 = 1_000 * S
SETTINGS = KernelSettings(strict=True)


def walk(first_s: float, last_s: float, *, every_s: float = 0.1, offset_ns: int = T0, **fields: Any) -> list[Event]:
    """Return batches of 50 Hz acceleration from ``first_s`` up to, not including, ``last_s``."""
    batches: list[Event] = []
    for start in np.arange(round(first_s * 1000), round(last_s * 1000), round(every_s * 1000)).tolist():
        t_ns = offset_ns + MS * np.arange(start, start + round(every_s * 1000), 20)
        rows = np.column_stack([np.sin(t_ns % S / 1e8), np.zeros(len(t_ns)), np.full(len(t_ns), 9.8)])
        batches.append(motion_samples(t_ns, accelerometer=rows, device="d", **fields))
    return batches


def scan(t_s: float, *heard: str, offset_ns: int = T0, **fields: Any) -> Scan:
    """Return a scan that heard these transmitters just then."""
    t_ns = offset_ns + round(t_s * 1000) * MS
    n = len(heard)
    rssi_dbm, heard_ns = np.full(n, -60.0), np.full(n, t_ns)
    return Scan(transmitters=heard, rssi_dbm=rssi_dbm, heard_ns=heard_ns, t_ns=t_ns, device="d", **fields)


def sample(t_s: float, value: float = 1.0, offset_ns: int = T0, **fields: Any) -> MotionSamples:
    """Return a single acceleration."""
    return motion_samples([offset_ns + round(t_s * 1000) * MS], accelerometer=[[value, 0, 0]], device="d", **fields)


def run(events: Iterable[Event], settings: KernelSettings = SETTINGS, **toy: Any) -> Folded:
    """Fold the events with one pipeline of toys."""
    return fold([toy_pipeline(**toy)], events, settings)


def ticks(estimates: Sequence[Estimate]) -> list[tuple[int, float]]:
    """Return epoch and seconds since T0 of the estimates."""
    return [(e.epoch, (e.t_ns - T0) / S) for e in estimates]


def published(folded: Folded) -> list[Estimate]:
    """Return the published track of the one pipeline."""
    return folded.published.get(("d", "toy"), [])


def settled(folded: Folded) -> list[Estimate]:
    """Return the settled track of the one pipeline."""
    return folded.settled.get(("d", "toy"), [])
