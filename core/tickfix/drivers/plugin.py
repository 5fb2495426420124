"""The sinks that come with tickfix, offered as anybody's would be."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tickfix.api import hookimpl
from tickfix.drivers.sinks import GeoJsonSink, JsonLinesSink

TICKFIX_API = 1


@hookimpl
def tickfix_register() -> Sequence[type[Any]]:
    """Offer the sinks."""
    return [JsonLinesSink, GeoJsonSink]
