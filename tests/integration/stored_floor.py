"""Simulated walks stored as recordings in the indoor-location format, and how tests call the command."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from tickfix.api import Floor, MotionSamples, Recording, Scan, Truth

Command = Callable[..., subprocess.CompletedProcess[str]]

_TYPES = {
    "accelerometer": "ACCELEROMETER",
    "gyroscope": "GYROSCOPE",
    "magnetometer": "MAGNETIC_FIELD",
    "rotation_vector": "ROTATION_VECTOR",
}


def write_walk(recording: Recording, folder: Path) -> None:
    """Write a simulated walk in the indoor-location format, line by line as it arrived."""
    lines = [line for event in recording.events for line in _lines(event)]
    text = "".join(f"{line}\n" for line in lines)
    (folder / f"{recording.name}.txt").write_text(text, encoding="utf-8")


def write_plan(floor: Floor, folder: Path) -> None:
    """Write a plan as the two files of the indoor-location format."""
    info = {"map_info": {"width": floor.width_m, "height": floor.height_m}}
    corners = [(0.0, 0.0), (floor.width_m, 0.0), (floor.width_m, floor.height_m), (0.0, floor.height_m), (0.0, 0.0)]
    shapes: list[dict[str, Any]] = [{"type": "Polygon", "coordinates": [corners]}]
    shapes += [{"type": "Polygon", "coordinates": [[*r.tolist(), r[0].tolist()]]} for r in floor.obstacles]
    shapes += [{"type": "LineString", "coordinates": wall.tolist()} for wall in floor.walls]
    features = [{"type": "Feature", "properties": {}, "geometry": shape} for shape in shapes]
    (folder / "floor_info.json").write_text(json.dumps(info), encoding="utf-8")
    plan = {"type": "FeatureCollection", "features": features}
    (folder / "geojson_map.json").write_text(json.dumps(plan), encoding="utf-8")


def _lines(event: object) -> Iterator[str]:
    if isinstance(event, MotionSamples):
        for sensor, samples in event.sensors.items():
            rows: Sequence[Sequence[float]] = samples.values[:, :3].tolist()
            for t_ns, row in zip(samples.t_ns.tolist(), rows, strict=True):
                yield "\t".join([f"{t_ns // 10**6}", f"TYPE_{_TYPES[sensor]}", *map(repr, row), "3"])
    elif isinstance(event, Scan):
        for name, rssi, heard_ns in zip(event.transmitters, event.rssi_dbm, event.heard_ns, strict=True):
            yield f"{event.arrival_ns // 10**6}\tTYPE_WIFI\toffice\t{name}\t{rssi:.0f}\t2412\t{heard_ns // 10**6}"
    elif isinstance(event, Truth):
        yield f"{event.t_ns // 10**6}\tTYPE_WAYPOINT\t{float(event.xy[0])}\t{float(event.xy[1])}"
