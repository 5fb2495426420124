"""docs/journal.md says what the code does."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

from tickfix.journal import JournalSettings, RecordKind, RunManifest
from tickfix.journal.segment_layout import CHANNEL_IDS, JOURNAL_FORMAT

PAGE = (Path(__file__).parents[3] / "docs" / "journal.md").read_text("utf-8")


def test_settings_and_their_defaults() -> None:
    told: dict[str, float | None] = {}
    for names, values in re.findall(r"^\| ((?:`\w+`(?:, )?)+) \| ([\d., ]+|none) \|", PAGE, re.MULTILINE):
        keys = re.findall(r"\w+", names)
        given = [None] * len(keys) if values == "none" else [float(value) for value in values.split(", ")]
        told |= dict(zip(keys, given, strict=True))
    assert told == {field.name: field.default for field in fields(JournalSettings)}


def test_channels_and_the_keys_of_the_manifest(manifest: RunManifest) -> None:
    topics = ", ".join(f"`{kind.value}`" for kind in RecordKind)
    assert f"ids 1 to {len(RecordKind)}, without schema, message encoding `msgpack`; topics {topics}" in PAGE
    assert list(CHANNEL_IDS.values()) == list(range(1, len(RecordKind) + 1))
    section = PAGE.partition("### Manifest")[2].partition("###")[0]
    keys = re.findall(r"`([\w/]+)`", "".join(line.split("|")[1] for line in section.splitlines() if "| `" in line))
    written = {re.sub(r"^plugin/.*", "plugin/DISTRIBUTION", key) for key in manifest.entries()}
    assert {re.sub(r"^note/.*", "note/NAME", key) for key in written} == set(keys)
    assert f"| `format` | `{JOURNAL_FORMAT}`;" in PAGE
