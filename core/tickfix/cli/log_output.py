"""Where the records of the loggers ``tickfix.*`` go while a command runs: as text or as JSON, one line each.

A record carries a stable ``code``, snake_case, by which programs tell one kind of message from another, and the
``device`` that it concerns, if any: ``logger.warning("…", extra={"code": "overload"})``.
"""

from __future__ import annotations

import json
import logging
import sys
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any

_FIELDS = ("code", "device")


class LogFormat(StrEnum):
    """How log records are written."""

    TEXT = "text"
    JSON = "json"


class LogLevel(StrEnum):
    """The least severe records that are written."""

    DEBUG = "debug"
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


class JsonFormatter(logging.Formatter):
    """One JSON object per record: time (UTC), level, logger, message, and code, device and exception where given."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the record as one line."""
        line: dict[str, Any] = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        line |= _fields(record)
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        return json.dumps(line, ensure_ascii=False)


class NoticeFormatter(logging.Formatter):
    """The lines of ``tickfix serve --json``: the message as ``notice``, with code and device where given."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the record as one line."""
        return json.dumps({"notice": record.getMessage()} | _fields(record), ensure_ascii=False)


def configure_logging(log_format: LogFormat | None, level: LogLevel, *, notices: bool = False) -> None:
    """Write the records of ``tickfix`` from now on.

    Args:
        log_format: on stderr; None stands for text.
        level: records below it are dropped.
        notices: records go to stdout among the JSON lines of ``--json``, unless a format was chosen. Critical ones,
            which say why the command failed, stay on stderr.
    """
    root = logging.getLogger("tickfix")
    root.handlers.clear()
    root.propagate = False
    root.setLevel(level.upper())
    to_stderr = logging.StreamHandler(sys.stderr)
    to_stderr.setFormatter(
        JsonFormatter() if log_format is LogFormat.JSON else logging.Formatter("tickfix: %(message)s")
    )
    root.addHandler(to_stderr)
    if notices and log_format is None:
        to_stderr.setLevel(logging.CRITICAL)
        to_stdout = logging.StreamHandler(sys.stdout)
        to_stdout.setFormatter(NoticeFormatter())
        to_stdout.addFilter(lambda record: record.levelno < logging.CRITICAL)
        root.addHandler(to_stdout)


def _fields(record: logging.LogRecord) -> dict[str, Any]:
    return {name: getattr(record, name) for name in _FIELDS if hasattr(record, name)}
