"""The plugin hook that registers the readers of tickfix."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tickfix.api import hookimpl
from tickfix.readers.event_file import EventFileReader
from tickfix.readers.indoor_location import IndoorLocationReader

TICKFIX_API = 1


@hookimpl
def tickfix_register() -> Sequence[type[Any]]:
    """Offer the readers."""
    return [IndoorLocationReader, EventFileReader]
