"""An engine with keys, and the commands that talk to it: with the right ones, with others, and without."""

from __future__ import annotations

import json
from pathlib import Path

from live_lab import LIGHT, PORTS, Lab, outcome, until
from stored_floor import Command

from tickfix.cli.keys import app as keys_app
from tickfix.client import Control, Keys


def make(*arguments: object) -> None:
    """Run ``tickfix keys``, in this process: nothing in it lives on."""
    keys_app([str(argument) for argument in arguments], standalone_mode=False)


def test_commands_come_in_with_their_keys_and_are_told_what_to_do_without(
    lab: Lab, floor_folder: Path, tickfix: Command
) -> None:
    keys = lab.place / "keys"
    make("new", "engine", "--folder", keys)
    make("new", "phone", "--folder", keys, "--device", "survey-F1-01", "--port", "sensors")
    make("new", "desk", "--folder", keys, "--port", "positions", "--port", "control")
    make("new", "stranger", "--folder", keys)
    desk, phone, stranger = (("--key", keys / f"{name}.key") for name in ("desk", "phone", "stranger"))
    one, other = sorted((floor_folder / "path_data_files").glob("*.txt"))[:2]

    refused = tickfix("serve", lab.site, "--sensors", "tcp://0.0.0.0:*", code=2).stderr
    assert "tickfix keys new engine --folder keys" in refused
    engine = lab.serve(LIGHT, "--keys", keys, at=dict.fromkeys(PORTS, "tcp://0.0.0.0:*"))
    sensors, positions, control = (engine.at[name] for name in ("sensors", "positions", "control"))

    listener = lab.start("listen", positions, "--count", "5", "--timeout", "60", "--json", *desk)
    with Control(control, keys=Keys.read(keys / "desk.key", keys / "engine.pub"), timeout_s=60.0) as asked:
        until(lambda: asked.counters()["ports"]["keys"]["admitted"].get("positions", 0) > 0)
    assert outcome(lab.send(engine, one, "--speed", "0", *phone))["unknown"] == 0
    said, errors = listener.communicate(timeout=60)
    assert "5 estimates heard" in errors
    assert {json.loads(line).get("device", "survey-F1-01") for line in said.splitlines()} == {"survey-F1-01"}
    before = json.loads(tickfix("status", control, "--json", "--timeout", "60", *desk).stdout)["intake"]
    assert before["accepted"] > 100
    assert not before["unauthorised"]

    # A device that the key is not bound to: each message is refused and counted, and the sender says what to do.
    done = tickfix("send", other, "--to", sensors, "--speed", "0", *phone, code=1)
    assert "device: found 'survey-F1-02'; expected one of survey-F1-01, bound to the key of 'phone'" in done.stdout
    assert "tickfix keys allow" in done.stdout
    # A key that is not listed, one listed for other ports, and none: nothing comes in, and nobody waits in vain.
    done = tickfix("send", one, "--to", sensors, "--speed", "0", *stranger, code=2)
    assert "the engine does not let this key in here; put it on the engine's allow-list" in done.stderr
    assert "tickfix keys allow" in tickfix("status", control, "--timeout", "60", *phone, code=2).stderr
    done = tickfix("listen", positions, code=2)
    assert "the engine requires a key, and none was given" in done.stderr
    assert "tickfix keys new" in done.stderr

    with Control(control, keys=Keys.read(keys / "desk.key", keys / "engine.pub"), timeout_s=60.0) as asked:
        counters = asked.counters()["ports"]
    intake = counters["intake"]
    assert intake["received"] == sum(intake["outcomes"].values())
    # A sender in a hurry is throttled before anybody looks at what it sends.
    changed = {name for name, n in intake["outcomes"].items() if n != before[name]}
    assert changed - {"throttled"} == {"unauthorised"}
    assert counters["keys"]["refused"].keys() == {"sensors", "control"}
    engine.stop()
