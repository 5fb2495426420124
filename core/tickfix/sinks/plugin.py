"""The plugin hook that registers the sinks of tickfix."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tickfix.api import hookimpl
from tickfix.sinks.file_sinks import GeoJsonSink, JsonLinesSink

TICKFIX_API = 1


@hookimpl
def tickfix_register() -> Sequence[type[Any]]:
    """Offer the sinks."""
    return [JsonLinesSink, GeoJsonSink]
