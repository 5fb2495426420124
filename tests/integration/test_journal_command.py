"""``tickfix journal``: info, verify and export, on a journal of real events and estimates."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from journal_child import MANIFEST
from mcap.reader import SeekingReader
from stored_floor import Command
from typer.testing import CliRunner, Result

from tickfix.api import Belief, ConfigError, Estimate, Fix, Pressure, Scan, Status, motion_samples
from tickfix.cli.journal import app, export
from tickfix.journal import JournalReader, JournalWriter, RecordKind
from tickfix.wire import encode_estimate, encode_event
from tickfix.wire.engine_messages import RunDevice, encode_decision

EVENTS = (
    motion_samples([1, 2], gyroscope=np.arange(6.0).reshape(2, 3), device="a", session="s", seq=1),
    Scan(transmitters=("x", "y"), rssi_dbm=[-40.0, -50.5], heard_ns=[5, 6], device="a"),  # type: ignore[arg-type]
    Pressure(t_ns=7, pressure_hpa=1013.25, device="a"),
    Fix(t_ns=8, floor="F2", xy=np.array([4.0, 5.0]), device="b"),
)


def estimate(tick: int, belief: Belief | None) -> Estimate:
    status = Status.INITIALISING if belief is None else Status.TRACKING
    return Estimate(
        device="a", pipeline="fusion", epoch=0, tick=tick, t_ns=tick * 200_000_000, status=status, belief=belief
    )


ESTIMATES = (
    estimate(1, None),
    estimate(2, Belief(floor="F1", xy=np.array([1.5, 2.5]), covariance=np.eye(2), heading_rad=math.pi / 2)),
    estimate(3, Belief(floor="F1", xy=np.array([2.5, 2.5]), covariance=np.eye(2), speed_mps=math.nan)),
)


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    folder = tmp_path / "journal"
    with JournalWriter(folder, MANIFEST) as writer:
        for event in EVENTS:
            writer.append(RecordKind.EVENT, event.device, event.t_ns, encode_event(event))
            writer.commit()
        writer.roll_segment(b"\xc1 opaque")
        for said in ESTIMATES:
            writer.append(
                RecordKind.DECISION, said.device, said.t_ns, encode_decision(RunDevice(device="a", tick=said.tick))
            )
            writer.append(RecordKind.ESTIMATE, said.device, said.t_ns, encode_estimate(said))
            writer.commit()
    return folder


def invoke(*arguments: object, code: int = 0) -> Result:
    """Run the command in this process, where starting another would tell no more."""
    result = CliRunner().invoke(app, list(map(str, arguments)), env={"COLUMNS": "160"})
    assert result.exit_code == code, result.output
    return result


def test_info_and_verify_tell_what_there_is_and_what_is_damaged(journal: Path) -> None:
    said = invoke("info", journal).stdout
    for words in ("r-1, begun 1970-01-01 00:00:00", "plugins  tickfix 0.1.0", "1–4", "5–11", "closed, replays"):
        assert words in said
    assert "11 intact records in 2 segments, 0 of them damaged" in invoke("verify", journal).stdout
    first, second = JournalReader(journal).paths()
    raw = bytearray(first.read_bytes())
    at = raw.index(b"pressure")
    raw[at] ^= 32
    first.write_bytes(raw)
    second.write_bytes(second.read_bytes()[:-700])
    told = json.loads(invoke("verify", journal, "--json", code=1).stdout)
    (flipped,) = told["segments"][0]["damage"]
    (cut,) = told["segments"][1]["damage"]
    assert flipped["offset"] < at < flipped["offset"] + 200
    assert "checksum" in flipped["what"]
    assert "cut off" in cut["what"]
    assert told["missing"] == [f"{first}: 1 of the records 1–4 are missing"]
    assert [s["complete"] for s in told["segments"]] == [True, False]
    assert f"{first}: at byte {flipped['offset']}: " in invoke("verify", journal, code=1).stdout
    warned = invoke("export", journal, "--out", journal.parent / "damaged.jsonl").stderr
    assert f"tickfix: warning: {first}: at byte {flipped['offset']}" in warned
    assert "records 3–3 are missing" in warned


def test_export_writes_json_lines_of_all_that_was_kept(tickfix: Command, journal: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.jsonl"
    assert f"10 records are in {out}" in tickfix("journal", "export", journal, "--out", out).stdout
    lines = [json.loads(line) for line in out.read_text("utf-8").splitlines()]
    assert [line["number"] for line in lines] == [1, 2, 3, 4, 6, 7, 8, 9, 10, 11]
    assert [line["type"] for line in lines[:4]] == ["MotionSamples", "Scan", "Pressure", "Fix"]
    assert lines[0]["sensors"] == {"gyroscope": {"t_ns": [1, 2], "values": [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]]}}
    assert (lines[1]["transmitters"], lines[1]["rssi_dbm"]) == (["x", "y"], [-40.0, -50.5])
    assert (lines[3]["device"], lines[3]["xy"]) == ("b", [4.0, 5.0])
    assert lines[4] == {"number": 6, "kind": "decision", "wall_ns": lines[4]["wall_ns"], "type": "RunDevice"} | {
        "device": "a",
        "tick": 1,
        "most": None,
    }
    assert (lines[7]["status"], lines[7]["belief"]["xy"]) == ("tracking", [1.5, 2.5])
    assert lines[9]["belief"]["speed_mps"] is None
    assert lines[5]["belief"] is None


def test_export_writes_poses_that_foxglove_draws(tickfix: Command, journal: Path, tmp_path: Path) -> None:
    out = tmp_path / "poses.mcap"
    assert f"3 poses are in {out}" in tickfix("journal", "export", journal, "--out", out).stdout
    with out.open("rb") as file:
        found = list(SeekingReader(file, validate_crcs=True).iter_messages())
    assert [channel.topic for _, channel, _ in found] == ["/fix/b", "/estimate/a/fusion", "/estimate/a/fusion"]
    for schema, channel, message in found:
        assert schema is not None
        assert (schema.name, schema.encoding, channel.message_encoding) == (
            "foxglove.PoseInFrame",
            "jsonschema",
            "json",
        )
        pose = json.loads(message.data)
        assert set(json.loads(schema.data)["properties"]) == set(pose) == {"timestamp", "frame_id", "pose"}
        assert pose["timestamp"]["sec"] * 10**9 + pose["timestamp"]["nsec"] == message.log_time
    east, north = (json.loads(message.data) for _, _, message in (found[1], found[2]))
    assert (east["frame_id"], east["pose"]["position"]) == ("F1", {"x": 1.5, "y": 2.5, "z": 0.0})
    assert east["pose"]["orientation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    assert north["pose"]["orientation"]["w"] == 1.0


def test_mistakes_name_the_place_and_what_is_expected(tickfix: Command, journal: Path, tmp_path: Path) -> None:
    (line,) = tickfix("journal", "info", tmp_path / "none", code=2).stderr.splitlines()
    assert line == f"tickfix: {tmp_path / 'none'}: no readable folder (No such file or directory); expected a journal's"
    with pytest.raises(ConfigError, match=r"expected a name that ends in \.jsonl or \.mcap"):
        export(journal, out=tmp_path / "x.csv")
    with pytest.raises(ConfigError, match="expected a place outside the journal"):
        export(journal, out=journal / "9999999.mcap")
    assert len(JournalReader(journal).paths()) == 2
