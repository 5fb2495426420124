"""The page, the schema and the code say the same."""

from __future__ import annotations

import json
import re
from pathlib import Path

import msgpack
import msgspec
import pytest

from tickfix.api import LATEST_NS, SENSORS, Status
from tickfix.wire import (
    CONTROL_REQUESTS,
    OLDEST_VERSION,
    VERSION,
    MessageLimits,
    ReplyOutcome,
    decode_message,
    decode_request,
    message_to_event,
)
from tickfix.wire.schema import MESSAGES_BY_PORT, NESTED_TYPES, build_schema

DOCS = Path(__file__).parents[3] / "docs"
PAGE = (DOCS / "wire-protocol.md").read_text(encoding="utf-8")
TYPES = [kind for kinds in MESSAGES_BY_PORT.values() for kind in kinds] + list(NESTED_TYPES)
ROWS = [[cell.strip() for cell in row.split("|")[1:-1]] for row in PAGE.splitlines() if row.startswith("| ")]


def test_the_schema_in_the_docs_is_that_of_the_types():
    written = json.loads((DOCS / "wire-schema.json").read_text(encoding="utf-8"))
    assert written == build_schema(), "run `python -m tickfix.wire.schema > docs/wire-schema.json`"


def test_every_field_is_described_in_the_schema():
    for name, definition in build_schema()["$defs"].items():
        silent = [field for field, schema in definition.get("properties", {}).items() if "description" not in schema]
        # A decision is described as a whole.
        if "v" in definition.get("properties", {}) or name in {kind.__name__ for kind in NESTED_TYPES}:
            assert set(silent) <= {"type", "v"}, name


def test_the_schema_has_no_markup():
    assert not re.search(r":\w+:`|``", json.dumps(build_schema()))


@pytest.mark.parametrize("kind", TYPES, ids=lambda kind: kind.__name__)
def test_every_field_of_every_message_stands_on_the_page(kind):
    named = set(re.findall(r"\w+", " ".join(re.findall(r"`[^`]+`", re.sub(r"```.*?```", "", PAGE, flags=re.DOTALL)))))
    assert set(kind.__struct_fields__) <= named


@pytest.mark.parametrize("kind", TYPES, ids=lambda kind: kind.__name__)
def test_every_message_stands_on_the_page(kind):
    tag = kind.__struct_config__.tag
    assert tag is None or f"### `{tag}`" in PAGE or f'type: "{tag}"' in PAGE or f"\n| `{tag}` | " in PAGE


def test_the_page_tells_the_version():
    assert f"**version {VERSION}**" in PAGE
    assert f"`v`: the protocol version, {VERSION}." in PAGE
    assert f"\nVersion {VERSION}: " in PAGE.partition("## Changes")[2]
    assert (OLDEST_VERSION == VERSION) is ("of the latter there are none yet" in PAGE)


def test_the_page_tells_every_outcome_and_no_other():
    section = PAGE.partition("Every message has exactly one outcome:")[2].partition("## Positions")[0]
    assert re.findall(r"^\| `(\w+)`", section, re.MULTILINE) == [outcome.value for outcome in ReplyOutcome]


def test_the_page_tells_every_request_and_no_other():
    section = PAGE.partition("\n## Control")[2].partition("\n## ")[0]
    told = re.findall(r"^\| `([\w-]+)`", section, re.MULTILINE)
    assert sorted(told) == sorted([*CONTROL_REQUESTS, "what"])


def test_the_page_tells_the_limits():
    told = {row[0].strip("`"): row[1] for row in ROWS if len(row) == 3}
    for name in MessageLimits.__slots__:
        assert told[name] == str(getattr(MessageLimits(), name))


def test_page_and_schema_tell_from_when_to_when_times_run():
    assert f"Times run from 0 to {LATEST_NS} (2⁶² − 1;" in PAGE
    assert LATEST_NS == 2**62 - 1
    properties = build_schema()["$defs"]["PressureMessage"]["properties"]
    assert (properties["t_ns"]["minimum"], properties["t_ns"]["maximum"]) == (0, LATEST_NS)
    assert properties["arrival_ns"]["anyOf"][0]["maximum"] == 2**63 - 1
    (heard,) = (
        one
        for one in build_schema()["$defs"]["ScanMessage"]["properties"]["heard_ns"]["anyOf"]
        if one["type"] == "array"
    )
    assert (heard["items"]["minimum"], heard["items"]["maximum"]) == (0, LATEST_NS)


def test_the_page_tells_the_sensors():
    told = {row[0].strip("`"): (row[1], row[2]) for row in ROWS if len(row) == 3}
    for name, (columns, unit) in SENSORS.items():
        assert told[name] == (str(columns), unit)


def test_the_page_tells_every_status():
    (row,) = (row for row in ROWS if row[0] == "`status`" and len(row) == 3)
    assert re.findall(r"`(\w+)`", row[2]) == [status.value for status in Status]


def test_the_examples_are_understood():
    examples = [json.loads(text) for text in re.findall(r"```json\n(.*?)```", PAGE, re.DOTALL)]
    assert {example["type"] for example in examples} == {
        "motion", "scan", "pressure", "fix", "truth", "bye", "request",
    }  # fmt: skip
    for example in examples:
        data = msgpack.packb(example)
        if example["type"] == "request":
            assert decode_request(data).what == example["what"]
            continue
        message = decode_message(data, MessageLimits())
        assert msgspec.to_builtins(message).items() >= example.items()
        if example["type"] != "bye":
            message_to_event(message, 1)
