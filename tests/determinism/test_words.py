"""Code, messages and pages use the field's words: the private ones that they replaced do not come back."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("core", "plugins", "papers", "docs", "examples")
SUFFIXES = frozenset({".py", ".md", ".toml", ".css", ".mjs", ".html", ".j2"})

REPLACED = {
    "allowance": "token bucket",
    "anew": "again, or restart, redraw, reinitialise",
    "crew": "worker pool",
    "crowded": "overflow",
    "dice": "random number generator",
    "doorkeeper": "authenticator",
    "errand": "queued call",
    "last_words": "last values",
    "ledger": "write-ahead buffer",
    "lifeline": "parent-death watch",
    "mishap": "error",
    "obey": "handle_command",
    "outbox": "publish queue, or retransmit buffer",
    "overtaken": "out_of_order",
    "own_ways": "use_motion_noise",
    "put off": "deferred",
    "staffing": "wiring",
    "withheld": "suppressed",
}
"""Word → the standard term. Only words that mean nothing else here: a `beacon` is also a BLE transmitter."""

MAY_NAME = {"own_ways": re.compile(r"formerly=|renamed")}
"""Lines in which an old word is the point."""
LIVE_HAS_HEARTBEATS = "core/tickfix/live"


@cache
def lines_of_the_project() -> tuple[tuple[str, int, str], ...]:
    return tuple(_lines())


def _lines() -> Iterator[tuple[str, int, str]]:
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in SUFFIXES and "egg-info" not in str(path):
                for number, line in enumerate(path.read_text("utf-8").splitlines(), 1):
                    yield str(path.relative_to(ROOT)), number, line


def spelling(word: str) -> re.Pattern[str]:
    """Match the word alone, in the plural, and as a part of an identifier."""
    return re.compile(rf"(?<![a-z]){word}s?(?![a-z])", re.IGNORECASE)


@pytest.mark.parametrize("word", REPLACED)
def test_a_replaced_word_is_nowhere(word: str) -> None:
    pattern, allowed = spelling(word), MAY_NAME.get(word)
    found = [
        f"{where}:{number}: {line.strip()}"
        for where, number, line in lines_of_the_project()
        if pattern.search(line) and not (allowed and allowed.search(line))
    ]
    assert found == [], f"use: {REPLACED[word]}"


def test_a_beacon_is_a_transmitter() -> None:
    found = [
        f"{where}:{number}"
        for where, number, line in lines_of_the_project()
        if where.startswith(LIVE_HAS_HEARTBEATS) and spelling("beacon").search(line)
    ]
    assert found == [], "use: heartbeat"


def test_the_words_are_found_where_they_are() -> None:
    for text in ("the crew", "Crews", "_crew_size", "CREW"):
        assert spelling("crew").search(text), text
    for text in ("screw", "crewed", "recrew"):
        assert not spelling("crew").search(text), text
