"""Kinds of measurements that plugins declare: collected, checked, and named where they are wrong."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from tickfix.api import EventError, Fix, MotionSamples, ReaderError, Recording, Samples, Scan, Source, hookimpl
from tickfix.api.sources import check_declared
from tickfix.registry import Registry, discover
from tickfix.replay.recording_files import RecordingFile
from tickfix.wire import WireError, check_received_event

UWB = Source(name="uwb", shape="readings", columns={"range_m": "m", "range_sigma_m": "m"}, doc="Ranges to anchors.")
LIGHT = Source(name="light", shape="samples", columns={"illuminance_lx": "lx"})
SOURCES = {"uwb": UWB, "light": LIGHT}


@pytest.fixture
def plugin() -> Iterator[Callable[..., EntryPoint]]:
    made: list[str] = []

    def make(name: str, returned: Any) -> EntryPoint:
        @hookimpl
        def tickfix_sources() -> Any:
            return returned

        made.append(name)
        sys.modules[name] = ModuleType(name)
        sys.modules[name].__dict__["tickfix_sources"] = tickfix_sources
        return EntryPoint(name, name, "tickfix.plugins")

    yield make
    for name in made:
        del sys.modules[name]


def uwb_scan(**values: list[float]) -> Scan:
    return Scan(transmitters=("a",), heard_ns=[1], source="uwb", values=values)


def test_declared_sources_are_collected_by_name(plugin: Callable[..., EntryPoint]) -> None:
    found = discover([plugin("tf_b", [UWB]), plugin("tf_a", [LIGHT])])
    assert not found.problems
    assert dict(found.sources) == {"light": LIGHT, "uwb": UWB}
    assert found.declared["uwb"].origin == "tf_b"
    assert not found.observers


def test_what_cannot_be_declared_is_named_and_left_out(plugin: Callable[..., EntryPoint]) -> None:
    found = discover([plugin("tf_a", [UWB]), plugin("tf_b", [UWB, LIGHT]), plugin("tf_c", ["uwb"]), plugin("tf_d", 5)])
    assert list(found.sources) == ["light", "uwb"]
    assert [problem.problem for problem in found.problems] == [
        "source uwb is declared already by tf_a",
        "declares 'uwb', expected a tickfix.api.Source",
        "tickfix_sources failed: TypeError: 'int' object is not iterable",
    ]


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"name": "U W"}, "found name 'U W', expected lower-case words joined by _"),
        ({"shape": "images"}, "found shape 'images', expected one of samples, readings"),
        ({"columns": {}}, "found 0 columns, expected 1 to 64"),
        ({"name": "gyroscope", "shape": "samples"}, "found the name of a sensor of tickfix, expected another name"),
    ],
)
def test_a_declaration_that_cannot_be_is_refused(fields: dict[str, Any], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        Source(**{"name": "uwb", "shape": "readings", "columns": {"range_m": "m"}, **fields})


def test_events_of_declared_sources_are_checked_and_others_pass() -> None:
    check_declared(uwb_scan(range_m=[1.0], range_sigma_m=[0.1]), SOURCES)
    check_declared(Scan(transmitters=("a",), heard_ns=[1], source="rtt", values={"x": [1.0]}), SOURCES)
    check_declared(MotionSamples(sensors={"light": Samples([1], [[5.0]]), "nose": Samples([1], [[1.0, 2.0]])}), SOURCES)
    check_declared(Fix(t_ns=1, floor="F1", xy=np.zeros(2), source="gnss"), SOURCES)
    with pytest.raises(EventError, match=r"values: found range_m in a scan of uwb, expected range_m, range_sigma_m"):
        check_declared(uwb_scan(range_m=[1.0]), SOURCES)
    with pytest.raises(EventError, match=r"sensors.light: found 2 columns, expected 1: illuminance_lx \(lx\)"):
        check_declared(MotionSamples(sensors={"light": Samples([1], [[5.0, 6.0]])}), SOURCES)


def test_what_a_device_sends_is_checked_at_the_port() -> None:
    with pytest.raises(WireError) as caught:
        check_received_event(uwb_scan(distance=[1.0]), SOURCES)
    assert (caught.value.field, caught.value.found) == ("values", "distance in a scan of uwb")
    assert caught.value.expected == "range_m, range_sigma_m"


def test_what_a_reader_reads_is_checked(tmp_path: Path) -> None:
    class Broken:
        def read(self, path: Path) -> Recording:
            return Recording(name="a", floor="", events=(uwb_scan(distance=[1.0]),))

    file = RecordingFile(tmp_path / "a.uwb", "broken", Broken(), (UWB,))
    with pytest.raises(ReaderError, match=r"a.uwb: reader 'broken' failed: EventError: values: found distance"):
        file.read()


def test_a_declaration_goes_to_other_processes() -> None:
    assert pickle.loads(pickle.dumps(UWB)) == UWB  # noqa: S301 - our own
    assert Registry().sources == {}
