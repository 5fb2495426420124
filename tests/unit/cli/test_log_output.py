"""Log records as text, as JSON lines and as notices."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator

import pytest

from tickfix.cli.log_output import LogFormat, LogLevel, configure_logging

LOGGER = logging.getLogger("tickfix.live.test")


@pytest.fixture(autouse=True)
def _restored() -> Iterator[None]:
    root = logging.getLogger("tickfix")
    before = root.handlers[:], root.propagate, root.level
    yield
    root.handlers[:], root.propagate = before[:2]
    root.setLevel(before[2])


def test_text_goes_to_stderr_from_the_level_on(capsys: pytest.CaptureFixture[str]) -> None:
    configure_logging(None, LogLevel.WARNING)
    LOGGER.info("the loop keeps up again", extra={"code": "overload_ended"})
    LOGGER.warning("overload: %.1f s behind", 2.5, extra={"code": "overload"})
    logging.getLogger("another.library").error("not ours")
    shown = capsys.readouterr()
    assert (shown.out, shown.err) == ("", "tickfix: overload: 2.5 s behind\n")


def test_json_lines_carry_code_and_device(capsys: pytest.CaptureFixture[str]) -> None:
    configure_logging(LogFormat.JSON, LogLevel.INFO, notices=True)
    LOGGER.error("a message of %r failed", "dé", extra={"code": "message_failed", "device": "dé"})
    try:
        json.loads("}")
    except ValueError:
        LOGGER.critical("the engine crashed", exc_info=True, extra={"code": "engine_crashed"})
    shown = capsys.readouterr()
    first, second = map(json.loads, shown.err.splitlines())
    assert first.pop("time").endswith("+00:00")
    assert first == {
        "level": "error",
        "logger": "tickfix.live.test",
        "message": "a message of 'dé' failed",
        "code": "message_failed",
        "device": "dé",
    }
    assert second["code"] == "engine_crashed"
    assert second["exception"].startswith("Traceback")
    assert shown.out == ""


def test_notices_go_to_stdout_and_what_ends_the_command_to_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    configure_logging(None, LogLevel.INFO, notices=True)
    LOGGER.info("the loop keeps up again", extra={"code": "overload_ended"})
    LOGGER.critical("no such site", extra={"code": "engine_failed"})
    shown = capsys.readouterr()
    assert json.loads(shown.out) == {"notice": "the loop keeps up again", "code": "overload_ended"}
    assert shown.err == "tickfix: no such site\n"
