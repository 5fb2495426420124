"""tickfix's own event files: whole, cut, spoilt, and none at all."""

from __future__ import annotations

from pathlib import Path

import msgpack
import numpy as np
import pytest

from tickfix.api import Event, MotionSamples, ReaderError, Samples, Scan, Truth
from tickfix.readers.event_file import EventFileReader, write_events
from tickfix.wire import encode_event

EVENTS: tuple[Event, ...] = (
    MotionSamples(sensors={"gyroscope": Samples(np.array([1, 2]), np.ones((2, 3)))}, device="d", arrival_ns=5),
    Scan(transmitters=("a",), rssi_dbm=np.array([-50.0]), heard_ns=np.array([3]), device="d", arrival_ns=6),
    Truth(t_ns=4, floor="F", xy=np.array([1.0, 2.0]), device="d", arrival_ns=7),
)


def test_events_come_back_as_they_were(tmp_path: Path) -> None:
    write_events(tmp_path / "walk.events", EVENTS)
    reader = EventFileReader()
    assert reader.recordings(tmp_path) == [tmp_path / "walk.events"]
    assert reader.recordings(tmp_path / "walk.events") == [tmp_path / "walk.events"]
    recording = reader.read(tmp_path / "walk.events")
    assert [encode_event(e) for e in recording.events] == [encode_event(e) for e in EVENTS]
    assert (recording.name, recording.floor, dict(recording.rejected)) == ("walk", "F", {})


@pytest.mark.parametrize("cut", [1, 5, 30])
def test_a_cut_end_is_counted_and_the_rest_is_read(tmp_path: Path, cut: int) -> None:
    file = tmp_path / "walk.events"
    write_events(file, EVENTS)
    file.write_bytes(file.read_bytes()[:-cut])
    recording = EventFileReader().read(file)
    assert len(recording.events) == 2
    assert sum(recording.rejected.values()) == 1


def test_what_is_no_event_is_counted_one_by_one(tmp_path: Path) -> None:
    file = tmp_path / "walk.events"
    write_events(file, EVENTS)
    file.write_bytes(msgpack.packb(b"nonsense") + msgpack.packb(17) + file.read_bytes() + b"\xc1")
    recording = EventFileReader().read(file)
    assert len(recording.events) == 3
    assert dict(recording.rejected) == {"broken": 1, "no bytes": 1, "no event": 1}


def test_a_file_without_events_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty.events").write_bytes(b"")
    with pytest.raises(ReaderError, match="found 0 bytes without an event"):
        EventFileReader().read(tmp_path / "empty.events")
    with pytest.raises(ReaderError, match="missing"):
        EventFileReader().read(tmp_path / "missing.events")
