"""What a live run took in, as walks."""

from __future__ import annotations

from tickfix.api import Pressure
from tickfix.journal import JournalRecord, RecordKind
from tickfix.live.journal_replay import journaled_walks, on_device_clock
from tickfix.wire import encode_event
from tickfix.wire.engine_messages import FinishDevice, encode_decision

MS = 1_000_000
WALL = 10**18


def pressure(device: str, t_ms: int, arrival_ms: float) -> Pressure:
    return Pressure(t_ns=t_ms * MS, pressure_hpa=1e3, device=device, arrival_ns=WALL + round(arrival_ms * MS))


def test_a_device_that_left_and_came_back_walked_twice() -> None:
    records = []
    for kind, payload in (
        (RecordKind.EVENT, encode_event(pressure("a", 1, 1))),
        (RecordKind.EVENT, encode_event(pressure("b", 1, 2))),
        (RecordKind.DECISION, encode_decision(FinishDevice(device="a", reason="bye"))),
        (RecordKind.ESTIMATE, b"whatever was said"),
        (RecordKind.EVENT, encode_event(pressure("a", 3, 3))),
    ):
        records.append(JournalRecord(kind, len(records) + 1, "", 0, 0, payload))
    found = dict(journaled_walks(records))
    assert {name: [e.t_ns for e in events] for name, events in found.items()} == {"a": [MS], "b": [MS], "a-2": [3 * MS]}
    assert all(event.device == name for name, events in found.items() for event in events)


def test_arrivals_are_told_on_the_clock_of_the_device() -> None:
    events = [pressure("a", t, t + 500 + late) for t, late in ((0, 20), (100, 7), (200, 30), (300, 7), (250, 400))]
    arrived = [(e.arrival_ns - e.t_ns) // MS for e in on_device_clock(list(events))]
    assert arrived == [0, 0, 23, 0, 393]


def test_a_walk_that_was_sent_faster_than_it_happened_arrives_as_it_was_measured() -> None:
    events = [pressure("a", 100 * n, 20 * n) for n in range(10)]
    assert [e.arrival_ns for e in on_device_clock(list(events))] == [100 * MS * n for n in range(10)]
