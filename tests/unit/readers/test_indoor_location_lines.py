"""Broken lines: what is certain is recovered, the rest is counted, nothing is guessed."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tickfix.api import MotionSamples, ReaderError, Recording, Scan, Truth
from tickfix.readers.indoor_location import IndoorLocationReader
from tickfix.readers.indoor_location_log import log_entries
from tickfix.readers.input_files import RejectCounter

T0 = 1_574_559_495_401
ACC = f"{T0}\tTYPE_ACCELEROMETER\t0.1\t0.2\t9.8\t2"
GYRO = f"{T0 + 1}\tTYPE_GYROSCOPE\t0.01\t0.02\t0.03\t3"
WIFI = f"{T0 + 5}\tTYPE_WIFI\tshop\taa:bb:cc:dd:ee:ff\t-55\t2412\t{T0 - 100}"
WAYPOINT = f"{T0 + 9}\tTYPE_WAYPOINT\t12.5\t93.25"


def read(tmp_path: Path, *lines: str | bytes, end: bytes = b"\n") -> Recording:
    path = tmp_path / "walk.txt"
    path.write_bytes(b"\n".join(line.encode() if isinstance(line, str) else line for line in lines) + end)
    return IndoorLocationReader().read(path)


def motion(recording: Recording, sensor: str) -> np.ndarray:
    parts = [e.sensors[sensor].values for e in recording.events if isinstance(e, MotionSamples) and sensor in e.sensors]
    return np.concatenate(parts) if parts else np.zeros((0, 3))


def test_times_beyond_those_that_tickfix_knows_are_counted_and_left_out(tmp_path: Path) -> None:
    late = [line.replace(str(T0)[:7], "9999999") for line in (ACC, GYRO, WAYPOINT)]
    with pytest.raises(ReaderError, match="found"):
        read(tmp_path, *late)
    rejects = RejectCounter()
    assert list(log_entries("\n".join(late).encode(), rejects)) == []
    assert rejects.counts == {"implausible time": 3}
    assert "beyond 4611686018427 ms" in rejects.problems[0]


def test_clean_lines_are_read_without_rejects(tmp_path: Path) -> None:
    recording = read(tmp_path, "#\tstartTime:1", ACC, GYRO, WIFI, WAYPOINT)
    assert recording.rejected == {}
    assert recording.problems == ()
    assert [type(e) for e in recording.events] == [MotionSamples, Scan, Truth]


def test_two_records_joined_into_one_line_are_both_recovered_and_counted(tmp_path: Path) -> None:
    recording = read(tmp_path, WAYPOINT, ACC + GYRO)
    assert motion(recording, "accelerometer").tolist() == [[0.1, 0.2, 9.8]]
    assert motion(recording, "gyroscope").tolist() == [[0.01, 0.02, 0.03]]
    assert recording.rejected == {"joined line": 1}
    assert "line 2" in recording.problems[0]
    assert "9.8" in recording.problems[0]


def test_a_joined_wifi_line_is_recovered_because_its_last_column_is_a_complete_time(tmp_path: Path) -> None:
    recording = read(tmp_path, WIFI + ACC)
    (scan,) = (e for e in recording.events if isinstance(e, Scan))
    assert scan.heard_ns.tolist() == [(T0 - 100) * 1_000_000]
    assert recording.rejected == {"joined line": 1}


def test_a_joined_waypoint_is_refused_because_its_last_number_may_be_cut(tmp_path: Path) -> None:
    recording = read(tmp_path, WAYPOINT + ACC)
    assert recording.truth == ()
    assert motion(recording, "accelerometer").tolist() == [[0.1, 0.2, 9.8]]
    assert recording.rejected == {"cut line": 1, "joined line": 1}


def test_a_line_cut_before_the_next_record_loses_only_itself(tmp_path: Path) -> None:
    recording = read(tmp_path, ACC[:-6] + GYRO)
    assert motion(recording, "accelerometer").size == 0
    assert motion(recording, "gyroscope").tolist() == [[0.01, 0.02, 0.03]]
    assert recording.rejected == {"cut line": 1, "joined line": 1}


def test_a_file_that_ends_within_a_number_does_not_become_another_number(tmp_path: Path) -> None:
    recording = read(tmp_path, ACC, WAYPOINT[:-3], end=b"")
    assert recording.truth == ()
    assert recording.rejected == {"cut line": 1}


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (f"{T0}\tTYPE_SONAR\t1", "unknown type"),
        (f"{T0}\tTYPE_ACCELEROMETER\tNaN\t0\t9.8\t2", "non-finite number"),
        (f"{T0}\tTYPE_GYROSCOPE\t0\tinf\t0\t2", "non-finite number"),
        (f"{T0}\tTYPE_GYROSCOPE\t0\t1_0\t0\t2", "not a number"),
        (f"{T0}\tTYPE_GYROSCOPE\t0\tzero\t0\t2", "not a number"),
        (f"{T0}\tTYPE_GYROSCOPE\t0\t0", "missing columns"),
        (f"{T0}\tTYPE_GYROSCOPE\t0\t0\t0\t3\t9", "too many columns"),
        (f"{T0}\tTYPE_ROTATION_VECTOR\t0.9\t0.9\t0.9\t3", "not a rotation"),
        (f"{T0}\tTYPE_WIFI\tshop\taa:bb\t-55\t2412", "missing columns"),
        (f"{T0}\tTYPE_WIFI\tshop\t\t-55\t2412\t{T0}", "broken transmitter id"),
        (f"{T0}\tTYPE_WIFI\tshop\taa:bb\t0\t2412\t{T0}", "implausible rssi"),
        (f"{T0}\tTYPE_WIFI\tshop\taa:bb\t-55\t2412\t{T0 + 60_000}", "heard after it was logged"),
        (f"{T0}\tTYPE_WIFI\tshop\taa:bb\t-55\t2412\t0", "implausible time"),
        (f"{T0 + 10**11}\tTYPE_WAYPOINT\t1\t2", "implausible time"),
        ("12\tTYPE_WAYPOINT\t1\t2", "broken line"),
        ("rubbish", "broken line"),
        (b"\xff\xfe\x00", "broken line"),
        (b"1574559495400\tTYPE_WIFI\tshop\taa:\xff\t-55\t2412\t1574559495400", "broken transmitter id"),
        (b"1574559495400\tTYPE_WAYPOINT\t1.\xff\t2", "not a number"),
    ],
)
def test_what_cannot_be_used_is_counted_by_reason_and_shown(tmp_path: Path, line: str | bytes, reason: str) -> None:
    recording = read(tmp_path, ACC, line, GYRO)
    assert recording.rejected == {reason: 1}
    assert recording.problems[0].startswith(f"line 2: {reason}: found ")
    assert len(motion(recording, "accelerometer")) == len(motion(recording, "gyroscope")) == 1


def test_known_types_that_nobody_uses_are_no_rejects(tmp_path: Path) -> None:
    unused = [f"{T0}\tTYPE_BLUE\t\t16:E5\t-95", f"{T0}\tTYPE_GYROSCOPE_UNCALIBRATED\t0\t0\t0\t0\t0\t0\t3"]
    assert read(tmp_path, *unused, ACC).rejected == {}


def test_bytes_that_are_no_utf8_in_a_network_name_cost_nothing(tmp_path: Path) -> None:
    recording = read(tmp_path, WIFI.encode().replace(b"shop", b"caf\xe9"))
    assert len(recording.events) == 1
    assert recording.rejected == {}


def test_windows_line_ends_are_line_ends(tmp_path: Path) -> None:
    recording = read(tmp_path, *(line + "\r" for line in (ACC, WIFI, WAYPOINT)))
    assert recording.rejected == {}
    assert recording.truth[0].xy.tolist() == [12.5, 93.25]


def test_a_cut_gzip_keeps_what_was_read(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    lines = [
        f"{T0 + 20 * i}\tTYPE_ACCELEROMETER\t{v[0]}\t{v[1]}\t{v[2]}\t3"
        for i, v in enumerate(rng.normal(size=(2000, 3)))
    ]
    path = tmp_path / "walk.txt.gz"
    path.write_bytes(gzip.compress("\n".join(lines).encode())[:-9000])
    recording = IndoorLocationReader().read(path)
    values = motion(recording, "accelerometer")
    assert 1000 < len(values) < 2000
    assert values.tolist() == rng.__class__(np.random.PCG64(1)).normal(size=(2000, 3))[: len(values)].tolist()
    assert recording.rejected["cut gzip"] == 1
    assert recording.name == "walk"


def test_a_corrupt_gzip_keeps_what_was_read(tmp_path: Path) -> None:
    lines = [f"{T0 + 20 * i}\tTYPE_ACCELEROMETER\t{i * 0.37}\t{i * 0.73}\t{i}\t3\n" for i in range(5000)]
    data = bytearray(gzip.compress("".join(lines).encode()))
    data[len(data) // 2 : len(data) // 2 + 64] = b"\xff" * 64
    path = tmp_path / "walk.txt.gz"
    path.write_bytes(bytes(data))
    recording = IndoorLocationReader().read(path)
    assert recording.rejected["cut gzip"] == 1
    assert len(motion(recording, "accelerometer")) > 1000


@pytest.mark.parametrize("content", [b"", b"#\tstartTime:1574559495255\n", b"rubbish\n", b"\x1f\x8b rubbish"])
def test_a_file_without_any_record_is_an_error_that_names_it(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "walk.txt"
    path.write_bytes(content)
    with pytest.raises(ReaderError, match=r"walk\.txt: nothing could be read"):
        IndoorLocationReader().read(path)


def test_a_missing_file_is_an_error_that_names_it(tmp_path: Path) -> None:
    with pytest.raises(ReaderError, match=r"gone\.txt: cannot be read"):
        IndoorLocationReader().read(tmp_path / "gone.txt")


@given(st.binary(max_size=300), st.integers(0, 3))
def test_no_bytes_whatsoever_crash_the_parser(noise: bytes, lines_before: int) -> None:
    data = "".join(f"{line}\n" for line in [ACC, WIFI, WAYPOINT][:lines_before]).encode() + noise
    found = list(log_entries(data, RejectCounter()))
    assert len(found) >= lines_before


@given(st.integers(0, len(f"{ACC}\n{WIFI}\n{WAYPOINT}\n{GYRO}\n") - 1))
def test_a_file_cut_anywhere_gives_a_beginning_of_what_it_held(cut: int) -> None:
    data = f"{ACC}\n{WIFI}\n{WAYPOINT}\n{GYRO}\n".encode()
    whole = [(r.type, r.columns) for r in log_entries(data, RejectCounter())]
    for (kind, columns), (whole_kind, whole_columns) in zip(
        [(r.type, r.columns) for r in log_entries(data[:cut], RejectCounter())], whole, strict=False
    ):
        assert kind == whole_kind
        assert columns == whole_columns[: len(columns)]
