"""The examples in JavaScript and ``tickfix.client`` on a real engine: from a sensor to a position and back out."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tickfix.client import Control, Listener

NODE = shutil.which("node")
JAVASCRIPT = Path(__file__).parents[2] / "examples" / "javascript"
PATIENCE_S = 60.0
PORTS = ("sensors", "positions", "control", "follow-bind")

pytestmark = pytest.mark.skipif(NODE is None, reason="Node.js is not installed")


def start(*command):
    return subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)  # noqa: S603


@pytest.fixture
def addresses(site):
    """Start an engine on free ports and return where they are; it must live until the test is over."""
    free = [option for port in PORTS for option in (f"--{port}", "tcp://127.0.0.1:*")]
    engine = start(sys.executable, "-m", "tickfix.cli.main", "serve", site, *free, "--json", "--no-watchdog")
    try:
        yield json.loads(engine.stdout.readline())
        assert engine.poll() is None
    finally:
        engine.kill()
        engine.communicate()


def test_a_sensor_in_javascript_is_followed_and_heard_of_in_javascript_and_python(addresses):
    here = Listener(addresses["positions"], ["estimate/"])
    listener = start(NODE, JAVASCRIPT / "listener.mjs", addresses["positions"], "estimate/", 5)
    sensor = start(NODE, JAVASCRIPT / "sensor.mjs", addresses["sensors"], "javascript", 30, 200)
    out, err = sensor.communicate(timeout=PATIENCE_S)
    assert sensor.returncode == 0, err
    assert sum(json.loads(out)["outcomes"].values()) >= 30
    out, err = listener.communicate(timeout=PATIENCE_S)
    assert listener.returncode == 0, err
    told = [json.loads(line) for line in out.splitlines()]
    assert {one["device"] for one in told} == {"javascript"}
    heard = here.receive(PATIENCE_S)
    assert (heard["device"], heard["type"]) == ("javascript", "estimate")
    assert here.missed == 0
    here.close()
    with Control(addresses["control"], timeout_s=PATIENCE_S) as control:
        assert control.status()["devices"] == 1
        assert control.subscribe_info()["run"] == addresses["run"]
