"""A replica does what it is told, and a repetition notices every byte that differs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from tickfix import config
from tickfix.api import Context, Event, Fix, MotionSamples, Samples, Scan
from tickfix.journal import JournalRecord, RecordKind
from tickfix.kernel import KernelSettings, MessageOutcome, Pipeline
from tickfix.live.journal_replay import replay_records
from tickfix.live.replica import Replica
from tickfix.registry import discover
from tickfix.wire import WireError, encode_estimate, encode_event
from tickfix.wire.engine_messages import (
    AdmitScan,
    Decision,
    DropScan,
    FinishDevice,
    RunDevice,
    SelectPrimary,
    decode_decision,
    encode_decision,
)

MS = 1_000_000
CONFIG = '[pipelines.k]\npdr = "steps"\nfilter = "kalman"\n[pipelines.d]\npdr = "steps"\nfilter = "dead-reckoning"\n'


@pytest.fixture(scope="module")
def pipelines() -> tuple[Pipeline, ...]:
    return config.build_pipelines(config.parse_config(CONFIG, "test", discover()).pipelines, Context(floors={}), {})


def story() -> Iterator[Event | Decision]:
    """A phone that walks past a few fixes, as an engine writes it down."""
    for n in range(60):
        t_ns = 200 * MS * n + 200 * MS
        times = t_ns - 200 * MS + np.arange(10) * 20 * MS
        values = np.stack([np.zeros(10), np.sin(times / 8e7), 9.8 + 2 * np.sin(times / 8e7)], axis=1)
        yield MotionSamples(sensors={"accelerometer": Samples(times, values)}, device="d", session="s", seq=n + 1)
        if n % 9 == 4:
            yield Fix(t_ns=t_ns - 50 * MS, floor="F", xy=np.array([0.1 * n, 1.0]), device="d")
        yield RunDevice(device="d")
        if n % 20 == 19:
            yield RunDevice(device="d", tick=n + 2)
    yield FinishDevice(device="d", reason="bye")


def written(replica: Replica) -> list[JournalRecord]:
    """Return the journal of the story."""
    records: list[JournalRecord] = []

    def add(kind: RecordKind, payload: bytes) -> None:
        records.append(JournalRecord(kind, len(records) + 1, "d", 0, 0, payload))

    for entry in story():
        if isinstance(entry, MotionSamples | Fix):
            add(RecordKind.EVENT, encode_event(entry))
            replica.event(len(records), entry)
            continue
        output, _ = replica.apply_decision(entry)  # type: ignore[arg-type]
        add(RecordKind.DECISION, encode_decision(entry))  # type: ignore[arg-type]
        for estimate in (*output.revised, *output.published):
            add(RecordKind.REVISION if estimate.revision else RecordKind.ESTIMATE, encode_estimate(estimate))
    return records


def test_a_repetition_says_the_same_bytes(pipelines: tuple[Pipeline, ...]) -> None:
    records = written(Replica(pipelines, KernelSettings()))
    said = [r for r in records if r.kind in (RecordKind.ESTIMATE, RecordKind.REVISION)]
    again = list(replay_records(iter(records), Replica(pipelines, KernelSettings())))
    assert len(again) == len(said) > 100
    assert any(r.kind is RecordKind.REVISION for r in said)
    assert all(difference is None for _, _, difference in again)


def test_a_repetition_goes_on_from_a_snapshot_in_the_middle(pipelines: tuple[Pipeline, ...]) -> None:
    records = written(Replica(pipelines, KernelSettings()))
    first = Replica(pipelines, KernelSettings())
    cut = next(i for i, r in enumerate(records) if i > 150 and r.kind is RecordKind.EVENT)
    list(replay_records(iter(records[:cut]), first))
    rest = [JournalRecord(RecordKind.SNAPSHOT, records[cut].number, "", 0, 0, first.snapshot()), *records[cut:]]
    again = list(replay_records(iter(rest), Replica(pipelines, KernelSettings())))
    assert len(again) > 50
    assert all(difference is None for _, _, difference in again)


def test_the_first_difference_is_named(pipelines: tuple[Pipeline, ...]) -> None:
    records = written(Replica(pipelines, KernelSettings()))
    where = [i for i, r in enumerate(records) if r.kind is RecordKind.ESTIMATE][40]
    estimate = list(replay_records(iter(records), Replica(pipelines, KernelSettings())))
    said = next(e for r, e, _ in estimate if r is records[where])
    assert said is not None
    assert said.belief is not None
    moved = replace(said, belief=replace(said.belief, xy=said.belief.xy + 1e-12))
    records[where] = replace(records[where], payload=encode_estimate(moved))
    found = [d for _, _, d in replay_records(iter(records), Replica(pipelines, KernelSettings())) if d is not None]
    assert [(d.number, d.fields) for d in found] == [(records[where].number, ("belief",))]
    assert f"tick {said.tick}, {said.pipeline}: belief differ" in str(found[0])


def test_an_estimate_too_many_and_one_too_few_are_noticed(pipelines: tuple[Pipeline, ...]) -> None:
    records = written(Replica(pipelines, KernelSettings()))
    where = [i for i, r in enumerate(records) if r.kind is RecordKind.ESTIMATE]
    fewer = [r for i, r in enumerate(records) if i != where[-1]]
    more = [*records, records[where[-1]]]
    assert any(d is not None for _, _, d in replay_records(iter(more), Replica(pipelines, KernelSettings())))
    shorter = [
        *fewer,
        JournalRecord(RecordKind.DECISION, 10**6, "d", 0, 0, encode_decision(RunDevice(device="nobody"))),
    ]
    assert any(d is not None for _, _, d in replay_records(iter(shorter), Replica(pipelines, KernelSettings())))


def test_a_scan_waits_for_its_decision(pipelines: tuple[Pipeline, ...]) -> None:
    replica = Replica(pipelines, KernelSettings())
    heard, rssi = np.array([5 * MS]), np.array([-50.0])
    scan = Scan(transmitters=("a",), rssi_dbm=rssi, heard_ns=heard, device="d")
    assert replica.event(1, scan) is None
    assert replica.event(2, scan) is None
    restored = Replica(pipelines, KernelSettings())
    restored.restore(replica.snapshot())
    assert list(restored.waiting) == [1, 2]
    assert restored.apply_decision(AdmitScan(number=1))[1] is MessageOutcome.ACCEPTED
    assert restored.apply_decision(DropScan(number=2, reason="late"))[1] is None
    assert restored.apply_decision(AdmitScan(number=3))[1] is None
    assert not restored.waiting
    restored.apply_decision(SelectPrimary(pipeline="k"))
    assert restored.primary == "k"


@pytest.mark.parametrize(
    "decision",
    [
        RunDevice(device="d", tick=None),
        RunDevice(device="d", tick=7),
        AdmitScan(number=3),
        DropScan(number=3, reason="r"),
        FinishDevice(device="d", reason="bye"),
        SelectPrimary(pipeline="p"),
    ],
)
def test_decisions_survive_their_bytes(decision: Decision) -> None:
    assert decode_decision(encode_decision(decision)) == decision


@pytest.mark.parametrize(
    "data", [b"", b"\x80", b"\xc1", b"\x81\xa1x" * 100_000, encode_decision(RunDevice(device="d"))[:-3]]
)
def test_bytes_that_are_no_decision_are_refused(data: bytes) -> None:
    with pytest.raises(WireError):
        decode_decision(data)
