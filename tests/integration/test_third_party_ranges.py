"""A third-party package brings ultra-wideband ranges: file, wire, journal, kernel, position."""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from stored_floor import Command

from tickfix.api import Context, Event, Floor, Scan, Truth
from tickfix.config import build_pipelines, parse_config
from tickfix.journal import JournalReader, JournalRecord, JournalWriter, RecordKind, RunManifest
from tickfix.journal.journal_export import record_to_json_line
from tickfix.kernel import Kernel, KernelSettings, KernelSnapshot, Pipeline
from tickfix.readers.event_file import EventFileReader, write_events
from tickfix.registry import Registry, discover
from tickfix.replay.recording_files import find_recordings
from tickfix.wire import (
    MessageLimits,
    check_received_event,
    decode_event,
    decode_message,
    encode_event,
    event_to_message,
    message_to_event,
)

PACKAGE = Path(__file__).parents[1] / "third_party" / "uwb_range"
ANCHORS = {"a1": (0.0, 0.0), "a2": (20.0, 0.0), "a3": (20.0, 10.0), "a4": (0.0, 10.0)}
SIGMA_M = 0.1


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """Install the package into a folder, as pip would: its module, and its entry points as its project names them."""
    project = tomllib.loads((PACKAGE / "pyproject.toml").read_text("utf-8"))["project"]
    folder = tmp_path / "site-packages"
    info = folder / f"uwb_range-{project['version']}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n", encoding="utf-8"
    )
    entries = [
        f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in points.items())
        for group, points in project["entry-points"].items()
    ]
    (info / "entry_points.txt").write_text("\n".join(entries), encoding="utf-8")
    (folder / "uwb_range.py").write_bytes((PACKAGE / "uwb_range.py").read_bytes())
    return folder


@pytest.fixture
def registry(installed: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Registry]:
    monkeypatch.syspath_prepend(installed)
    found = discover()
    assert not found.problems
    yield found
    monkeypatch.delitem(__import__("sys").modules, "uwb_range")


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    """Store a walk of twenty seconds along the room, ranged five times a second, with one broken line."""
    rng = np.random.default_rng(5)
    lines = ["# uwb-range 1 device=tag-1 floor=F1", "range soon a1 1 1"]
    for k in range(100):
        t_ms, xy = 1000 + 200 * k, np.array([2.0 + 0.15 * k, 5.0])
        lines += [
            f"range {t_ms} {name} {np.hypot(*(xy - place)) + rng.normal(0.0, SIGMA_M):.4f} {SIGMA_M}"
            for name, place in ANCHORS.items()
        ]
        lines.append(f"truth {t_ms} {xy[0]:.3f} {xy[1]:.3f}")
    path = tmp_path / "walk.uwb"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def pipelines(registry: Registry, folder: Path) -> tuple[Pipeline, ...]:
    anchors = folder / "anchors.csv"
    rows = [f"{name},F1,{x},{y}\n" for name, (x, y) in ANCHORS.items()]
    anchors.write_text("anchor,floor,x_m,y_m\n" + "".join(rows), encoding="utf-8")
    text = f'[pipelines.uwb]\nfingerprint = {{ use = "uwb-range", anchors = "{anchors}" }}\nfilter = "fixes"\n'
    floor = Floor(name="F1", width_m=20.0, height_m=10.0)
    config = parse_config(text, "uwb.toml", registry)
    return tuple(build_pipelines(config.pipelines, Context(floors={"F1": floor}), {}))


def over_the_wire(event: Event, registry: Registry) -> Event:
    received = message_to_event(decode_message(event_to_message(event), MessageLimits()), event.arrival_ns)
    check_received_event(received, registry.sources)
    return received


def journalled(events: list[Event], folder: Path) -> list[Event]:
    manifest = RunManifest("r", "0.2.0", "", 0, "ab" * 32, 1, {"uwb-range": "1.4"}, {})
    with JournalWriter(folder, manifest, wall_ns=lambda: 1) as writer:
        for event in events:
            writer.append(RecordKind.EVENT, event.device, event.t_ns, encode_event(event))
        writer.commit()
    return [decode_event(record.payload) for record in JournalReader(folder).records()]


def test_ranges_go_from_a_file_over_wire_and_journal_to_a_position(
    registry: Registry, walk: Path, tmp_path: Path
) -> None:
    (file,) = find_recordings([walk], registry).sources
    recording = file.read()
    assert (file.name, recording.rejected) == ("uwb-range", {"broken line": 1})
    truth = {event.t_ns: event.xy for event in recording.events if isinstance(event, Truth)}
    sent = [event for event in recording.events if isinstance(event, Scan)]
    events = journalled([over_the_wire(event, registry) for event in sent], tmp_path / "journal")
    assert [encode_event(event) for event in events] == [encode_event(event) for event in sent]

    made = pipelines(registry, tmp_path)
    kernel = Kernel(made, KernelSettings(strict=True, repack=True))
    estimates, observations = [], []
    for n, event in enumerate(events):
        assert kernel.feed(event) == "accepted"
        output = kernel.run("tag-1")
        estimates += output.settled
        observations += output.observations
        if n == 50:  # as after a crash: from the bytes of a snapshot
            kept = KernelSnapshot.unpacked(kernel.snapshot().packed())
            kernel = Kernel(made, KernelSettings(strict=True, repack=True))
            kernel.restore(kept)
    output = kernel.finish("tag-1")
    estimates, observations = estimates + output.settled, observations + output.observations
    errors_m = [np.hypot(*(e.belief.xy - truth[e.t_ns])) for e in estimates]
    assert len(errors_m) == 100
    assert np.sqrt(np.mean(np.square(errors_m))) < 2 * SIGMA_M

    assert len(observations) == 100
    grid = np.stack(np.meshgrid(np.linspace(0, 20, 81), np.linspace(0, 10, 41)), axis=-1).reshape(-1, 2)
    _, seen = observations[40]
    best = grid[seen.log_likelihood("F1", grid).argmax()]
    assert np.hypot(*(best - truth[seen.t_ns])) < 0.5
    assert np.isneginf(seen.log_likelihood("F2", grid)).all()


def test_event_files_and_exports_hold_the_ranges(registry: Registry, walk: Path, tmp_path: Path) -> None:
    (file,) = find_recordings([walk], registry).sources
    scan = next(event for event in file.read().events if isinstance(event, Scan))
    write_events(tmp_path / "again.events", [scan])
    (again,) = EventFileReader().read(tmp_path / "again.events").events
    assert encode_event(again) == encode_event(scan)
    record = JournalRecord(RecordKind.EVENT, 1, scan.device, scan.t_ns, 1, encode_event(scan))
    line = json.loads(record_to_json_line(record))
    assert line["values"] == {name: column.tolist() for name, column in scan.values.items()}
    assert line["rssi_dbm"] == [None] * len(scan)


def test_the_command_lists_the_package_and_its_source(tickfix: Command, installed: Path) -> None:
    env = {"PYTHONPATH": os.pathsep.join(filter(None, [str(installed), os.environ.get("PYTHONPATH")]))}
    found = json.loads(tickfix("plugins", "--json", env=env).stdout)
    assert {(p["kind"], p["name"]) for p in found["plugins"] if p["distribution"] == "uwb-range"} == {
        ("reader", "uwb-range"),
        ("fingerprint", "uwb-range"),
    }
    (source,) = found["sources"]
    assert (source["name"], source["shape"], source["version"]) == ("uwb", "readings", "1.4")
    assert source["columns"] == {"range_m": "m", "range_sigma_m": "m"}
    assert "Ultra-wideband ranges to anchors." in tickfix("plugins", env=env | {"COLUMNS": "200"}).stdout
