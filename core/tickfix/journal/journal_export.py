"""Exports a journal's records for other programs: JSON lines, and poses for Foxglove in an MCAP file."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from mcap.writer import Writer

from tickfix.api import Fix, Floats, TickfixError
from tickfix.journal.segment_layout import JournalRecord, RecordKind
from tickfix.wire import decode_estimate, decode_event
from tickfix.wire.engine_messages import decode_decision

_PAYLOAD_DECODERS: Final = {
    RecordKind.EVENT: decode_event,
    RecordKind.DECISION: decode_decision,
    RecordKind.ESTIMATE: decode_estimate,
    RecordKind.REVISION: decode_estimate,
}


def record_to_json_line(record: JournalRecord) -> bytes | None:
    """Return a record as a line of JSON; None for a snapshot, which holds no information beyond the other records.

    Beside ``number``, ``kind`` and ``wall_ns`` stand ``type`` (the class, such as ``ScanMessage`` or ``RunDevice``)
    and its fields
    under their own names; arrays are lists, row by row, and numbers that are not finite are null.

    Raises:
        TickfixError: when the payload is none of its kind.
    """
    decode = _PAYLOAD_DECODERS.get(record.kind)
    if decode is None:
        return None
    content: Any = decode(record.payload)
    head = {"number": record.number, "kind": record.kind, "wall_ns": record.wall_ns, "type": type(content).__name__}
    fields = msgspec.to_builtins(content, enc_hook=_to_builtin)
    fields.pop("type", None)
    return _encode_json(head | fields) + b"\n"


def _to_builtin(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TickfixError(f"a record's field holds {type(value).__name__}, which JSON cannot represent")


_encode_json: Final = msgspec.json.Encoder().encode


POSE_SCHEMA_NAME: Final = "foxglove.PoseInFrame"


def _number_properties(*names: str) -> dict[str, Any]:
    return {"type": "object", "properties": {name: {"type": "number"} for name in names}}


_POSE_SCHEMA: Final = {
    "title": POSE_SCHEMA_NAME,
    "type": "object",
    "properties": {
        "timestamp": {
            "type": "object",
            "title": "time",
            "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
        },
        "frame_id": {"type": "string"},
        "pose": {
            "title": "foxglove.Pose",
            "type": "object",
            "properties": {
                "position": _number_properties("x", "y", "z"),
                "orientation": _number_properties("x", "y", "z", "w"),
            },
        },
    },
}


class FoxglovePoseFile:
    """Writes ``foxglove.PoseInFrame`` messages in JSON: a topic for every device and pipeline, a frame for every floor.

    Topics are ``/estimate/DEVICE/PIPELINE``, ``/revision/DEVICE/PIPELINE`` and ``/fix/DEVICE``. Times are those of the
    wall clock when the record was written, since devices' clocks do not agree; ``publish_time`` is the device's.
    """

    def __init__(self, path: Path) -> None:
        """Begin the file.

        Raises:
            OSError: when the place cannot be written.
        """
        self._file = path.open("wb")
        self._writer: Any = Writer(self._file)  # Any: mcap leaves its methods without types
        self._writer.start("", "tickfix")
        self._schema = self._writer.register_schema(POSE_SCHEMA_NAME, "jsonschema", json.dumps(_POSE_SCHEMA).encode())
        self._channels: dict[str, int] = {}

    def write(self, record: JournalRecord) -> bool:
        """Write a record that has a position; return whether it had one.

        Raises:
            TickfixError: when the payload is none of its kind.
        """
        if record.kind in (RecordKind.ESTIMATE, RecordKind.REVISION):
            estimate = decode_estimate(record.payload)
            belief = estimate.belief
            if belief is None or not np.isfinite(belief.xy).all():
                return False
            topic = f"/{record.kind}/{estimate.device}/{estimate.pipeline}"
            self._pose(record, topic, belief.floor, belief.xy, belief.heading_rad)
            return True
        if record.kind is RecordKind.EVENT:
            event = decode_event(record.payload)
            if isinstance(event, Fix):
                self._pose(record, f"/fix/{event.device}", event.floor, event.xy, None)
                return True
        return False

    def close(self) -> None:
        """Complete the file."""
        try:
            self._writer.finish()
        finally:
            self._file.close()

    def _pose(self, record: JournalRecord, topic: str, floor: str, xy: Floats, heading_rad: float | None) -> None:
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, "json", self._schema)
        seconds, nanoseconds = divmod(record.wall_ns, 10**9)
        # From clockwise from north to anticlockwise from east, about the upward axis.
        half = 0.0 if heading_rad is None or not math.isfinite(heading_rad) else (math.pi / 2 - heading_rad) / 2
        pose = {
            "timestamp": {"sec": seconds, "nsec": nanoseconds},
            "frame_id": floor,
            "pose": {
                "position": {"x": float(xy[0]), "y": float(xy[1]), "z": 0.0},
                "orientation": {"x": 0.0, "y": 0.0, "z": math.sin(half), "w": math.cos(half)},
            },
        }
        self._writer.add_message(
            self._channels[topic],
            log_time=record.wall_ns,
            data=json.dumps(pose).encode(),
            publish_time=record.t_ns % 2**64,
            sequence=record.number % 2**32,
        )
