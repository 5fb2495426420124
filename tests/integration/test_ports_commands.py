"""``tickfix keys``, ``status`` and ``listen``, against real ports, in this process: it starts once."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from ports_lab import free_ports

from tickfix.api import TICK_NS, Belief, Estimate, Status
from tickfix.cli.main import main
from tickfix.ports import Hub, Publication
from tickfix.wire import encode_estimate

STATUS: dict[str, Any] = {
    "run": "r-17", "site": "office", "version": "0.1.0", "uptime_s": 93_784.0, "devices": 12, "ticks": 123_456,
    "tick_latency_ms": {"p50": 0.4, "p99": 3.25, "max": 11.0, "count": 0},
    "round_duration_ms": {"p50": 1.0, "p99": 2.0, "max": 3.0},
    "intake": {"accepted": 1_000, "late": 0, "malformed": 3}, "measurements": {}, "failures": {"filter:x": 2},
    "publications": {"sent": 99}, "overload": None,
    "pipelines": [{"name": "fusion", "primary": True, "state": "running"}, {"name": "pdr", "state": "disabled"}],
}  # fmt: skip


@dataclass(frozen=True)
class Done:
    stdout: str
    stderr: str


Command = Callable[..., Done]


@pytest.fixture
def tickfix(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    """Run ``tickfix`` with arguments, here; ``code`` is the exit code to expect."""
    monkeypatch.delenv("COLUMNS", raising=False)

    def run(*arguments: object, code: int = 0) -> Done:
        monkeypatch.setattr(sys, "argv", ["tickfix", *map(str, arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main()
        done = Done(*capsys.readouterr())
        assert (ended.value.code or 0) == code, done
        return done

    return run


@pytest.fixture
def open_hub() -> Iterator[Callable[..., Hub]]:
    hubs: list[Hub] = []

    def start(told: Any = STATUS, **settings: Any) -> Hub:
        hub = Hub(free_ports(**settings), run="r-17", site="office", describe=lambda what, args: told)
        hub.start()
        hubs.append(hub)
        return hub

    yield start
    for hub in hubs:
        hub.stop()


def estimate(tick: int) -> Publication:
    belief = Belief(floor="F1", xy=[12.5, -3.25], covariance=[[4.0, 0.0], [0.0, 5.0]])
    one = Estimate(
        device="phone", pipeline="fusion", epoch=0, tick=tick, t_ns=tick * TICK_NS, status=Status.TRACKING,
        belief=belief,
    )  # fmt: skip
    return Publication("estimate", "office", "F1", "phone", "fusion", encode_estimate(one))


def test_status_shows_what_the_engine_says(tickfix: Command, open_hub: Callable[..., Hub]) -> None:
    hub = open_hub()
    shown = tickfix("status", hub.addresses.control).stdout
    for text in (
        "office, run r-17, up 1 d 2 h: 12 devices, 123\u202f456 ticks", "keeps up",
        "p50 0.4 ms, p99 3.2 ms, max 11.0 ms, count 0",

        "accepted 1\u202f000, malformed 3", "filter:x 2", "fusion (primary, running), pdr (disabled)",
        "measurements     none", "journal          unknown",
    ):  # fmt: skip
        assert text in shown, shown
    assert json.loads(tickfix("status", hub.addresses.control, "--json").stdout) == STATUS


def test_status_says_overload_and_survives_an_answer_of_another_shape(
    tickfix: Command, open_hub: Callable[..., Hub]
) -> None:
    told = {"overload": "more than 1 s behind", "tick_latency_ms": None, "pipelines": "many", "new": {"a": {"b": 1.5}}}
    shown = tickfix("status", open_hub(told).addresses.control).stdout
    assert "overload: more than 1 s behind" in shown
    assert "unknown, run unknown, up unknown" in shown
    assert "(b 1.5)" in shown
    assert "no status" in tickfix("status", open_hub([1, 2]).addresses.control).stdout


def test_status_of_nobody_fails_in_one_line(tickfix: Command) -> None:
    done = tickfix("status", "tcp://127.0.0.1:1", "--timeout", 0.1, code=2)
    assert "no answer" in done.stderr
    assert done.stderr.count("\n") == 1


def test_listen_prints_estimates_with_keys_that_the_command_made(
    tickfix: Command, open_hub: Callable[..., Hub], tmp_path: Path
) -> None:
    keys = tmp_path / "keys"
    assert 'keys = "' in tickfix("keys", "new", "engine", "--folder", keys).stdout
    tickfix("keys", "new", "desk", "--folder", keys, "--port", "positions", "--port", "control")
    tickfix("keys", "new", "phone", "--folder", keys)
    tickfix("keys", "allow", "phone-1", keys / "phone.pub", "--folder", keys, "--port", "sensors", "--device", "p*")
    listed = json.loads(tickfix("keys", "list", "--folder", keys, "--json").stdout)
    assert listed == {
        "desk": {"devices": [], "ports": ["positions", "control"]}, "phone-1": {"devices": ["p*"], "ports": ["sensors"]}
    }  # fmt: skip

    hub = open_hub(keys=keys)
    hub.publish([estimate(1)])
    plain = tickfix("listen", hub.addresses.positions, "--count", 1, "--timeout", 60, "--key", keys / "desk.key")
    assert plain.stdout == "phone fusion tick 1: F1    12.50    -3.25 m ± 3.0 m tracking\n"
    assert "1 estimates heard" in plain.stderr
    as_json = tickfix(
        "listen", hub.addresses.positions, "--topic", "device/office/phone/", "--count", 1, "--json",
        "--timeout", 60, "--key", keys / "desk.key",
    )  # fmt: skip
    heard = json.loads(as_json.stdout)
    assert (heard["device"], heard["tick"], heard["belief"]["xy"]) == ("phone", 1, [12.5, -3.25])
    assert (
        json.loads(
            tickfix("status", hub.addresses.control, "--json", "--timeout", 60, "--key", keys / "desk.key").stdout
        )
        == STATUS
    )

    assert "allows desk no longer" in tickfix("keys", "withdraw", "desk", "--folder", keys).stdout
    refused = tickfix("status", hub.addresses.control, "--timeout", 60, "--key", keys / "desk.key", code=2)
    assert "the engine does not let this key in here; put it on the engine's allow-list" in refused.stderr


def test_the_list_keeps_what_people_wrote_and_a_bad_entry_changes_nothing(tickfix: Command, tmp_path: Path) -> None:
    tickfix("keys", "new", "a", "--folder", tmp_path, "--port", "control")
    file = tmp_path / "allowed.toml"
    file.write_text("# ours\n" + file.read_text() + "\n# the end\n")
    before = file.read_text()
    done = tickfix("keys", "new", "b", "--folder", tmp_path, "--port", "kitchen", code=2)
    assert "ports: found 'kitchen'" in done.stderr
    done = tickfix("keys", "withdraw", "c", "--folder", tmp_path, code=2)
    assert "found no key named 'c'; it has a" in done.stderr
    assert file.read_text() == before
    tickfix("keys", "new", "d", "--folder", tmp_path, "--port", "control")
    tickfix("keys", "withdraw", "d", "--folder", tmp_path)
    assert file.read_text().strip() == before.strip()


def test_listen_says_when_nothing_came(tickfix: Command, open_hub: Callable[..., Hub]) -> None:
    hub = open_hub()
    done = tickfix("listen", hub.addresses.positions, "--count", 1, "--timeout", 0.2, code=1)
    assert "0 estimates heard" in done.stderr
