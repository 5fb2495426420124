"""Small surveys made by hand for the tests of sites."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tickfix.api import Event, Floor, MotionSamples, Recording, Scan, Truth, motion_samples
from tickfix.site import Site
from tickfix.site.survey_builder import survey_recordings

S = 1_000_000_000
T0 = 1_574_559_495 * S


def walk(
    name: str, waypoints: Sequence[tuple[float, float, float]], scans: Sequence[Scan] = (), floor: str = "F1"
) -> Recording:
    """Return a walk through ``waypoints``, each (seconds since T0, x, y)."""
    truth = [Truth(t_ns=T0 + round(t * S), floor=floor, xy=np.array([x, y]), device=name) for t, x, y in waypoints]
    motion: list[MotionSamples] = [
        motion_samples([T0 + i * S // 5, T0 + i * S // 5 + 1], accelerometer=np.full((2, 3), float(i)))
        for i in range(3)
    ]
    events: list[Event] = [*motion, *scans, *truth]
    return Recording(name=name, floor=floor, events=tuple(sorted(events, key=lambda e: e.arrival_ns)))


def scan(*readings: tuple[str, float, float], source: str = "wifi") -> Scan:
    """Return a scan of readings, each (transmitter, dBm, seconds since T0)."""
    names, rssi_dbm, heard_s = zip(*readings, strict=True)
    heard_ns = np.array([T0 + round(t * S) for t in heard_s])
    return Scan(transmitters=names, rssi_dbm=np.array(rssi_dbm), heard_ns=heard_ns, source=source)


def small_site() -> Site:
    """Return a site with everything in it."""
    floor = Floor(
        name="F1",
        level=1,
        width_m=30.0,
        height_m=20.5,
        outline=(
            np.array([[0.0, 0.0], [30.0, 0.1], [30.0, 20.5], [0.0, 20.5]]),
            np.array([[10.0, 10.0], [11.0, 10.0], [11.0, 11.0]]),
        ),
        obstacles=(np.array([[1.0, 1.0], [1.0 / 3.0, 2.0], [2.0, 2.0]]),),
        walls=np.array([[[5.0, 0.0], [5.0, 7.7]], [[5.0, 7.7], [9.0, 7.7]]]),
    )
    first = walk("a", [(0, 1, 1), (10, 11, 1)], [scan(("ap1", -50, 2), ("ap2", -60, 3)), scan(("ap1", -55, 8))])
    second = walk("b", [(100, 3, 3), (110, 3, 13)], [scan(("ap3", -71, 105), ("ble:x", -80, 104))])
    site = survey_recordings([first, second], [floor, Floor(name="Ünter / 2")], name="small").site
    model = {"weights": np.arange(6, dtype=np.float32).reshape(2, 3), "file": np.array(["x", "yy"])}
    return Site(
        name=site.name,
        floors=site.floors,
        radio_map=site.radio_map,
        survey_tracks=site.survey_tracks,
        held_out=site.held_out,
        models={"pdr-steps-1a2b": model, "odd/../key": {"n": np.int64(3)}},
        notes=site.notes,
    )
