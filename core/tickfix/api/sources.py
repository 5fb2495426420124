"""Kinds of measurements that a plugin declares: further sensors, and scans with columns of their own."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Final, Literal

from tickfix.api.errors import EventError
from tickfix.api.events import MAX_COLUMNS, SENSORS, Event, MotionSamples, Scan

_NAME_PATTERN: Final = re.compile(r"[a-z][a-z0-9_]*")
_SHAPES: Final = ("samples", "readings")


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """A kind of measurement.

    The core carries any kind, declared or not, from readers and the wire through the journal to the stage that asks for
    it. Declaring one documents it (``tickfix plugins``) and has its columns checked where events come in.

    Attributes:
        name: of the sensor in :class:`MotionSamples`, or the ``source`` of a :class:`Scan`.
        shape: ``"samples"``: rows at instants, seen by dead reckoning; ``"readings"``: what a scan received from
            transmitters, seen by fingerprints.
        columns: name and unit of each column, in their order: of a row of samples, or the ``values`` of a scan. A scan
            that has a signal strength as well lists ``rssi_dbm``, which is not one of its ``values``.
        doc: what it is, a sentence.
    """

    name: str
    shape: Literal["samples", "readings"]
    columns: Mapping[str, str]
    doc: str = ""

    def __post_init__(self) -> None:
        """Check the declaration.

        Raises:
            ValueError: for a name that cannot be or is the core's, an unknown shape, and no or too many columns.
        """
        for name in (self.name, *self.columns):
            if not isinstance(name, str) or not _NAME_PATTERN.fullmatch(name):
                raise ValueError(f"source {self.name!r}: found name {name!r}, expected lower-case words joined by _")
        if self.shape not in _SHAPES:
            raise ValueError(f"source {self.name!r}: found shape {self.shape!r}, expected one of {', '.join(_SHAPES)}")
        if self.shape == "samples" and self.name in SENSORS:
            raise ValueError(f"source {self.name!r}: found the name of a sensor of tickfix, expected another name")
        if not 1 <= len(self.columns) <= MAX_COLUMNS:
            raise ValueError(f"source {self.name!r}: found {len(self.columns)} columns, expected 1 to {MAX_COLUMNS}")
        object.__setattr__(self, "columns", MappingProxyType(dict(self.columns)))

    def __reduce__(self) -> tuple[Callable[[], Source], tuple[()]]:
        """Return how to build it again in another process: a read-only mapping cannot be pickled."""
        return partial(Source, name=self.name, shape=self.shape, columns=dict(self.columns), doc=self.doc), ()


def check_declared(event: Event, sources: Mapping[str, Source]) -> None:
    """Check the columns of what an event holds of declared sources; anything else passes.

    Args:
        event: to check.
        sources: by name.

    Raises:
        EventError: naming the sensor or column, what was found and what is expected.
    """
    if isinstance(event, MotionSamples):
        for name, samples in event.sensors.items():
            source = sources.get(name)
            if source is not None and source.shape == "samples" and len(samples):
                found, expected = samples.values.shape[1], len(source.columns)
                if found != expected:
                    columns = ", ".join(f"{column} ({unit})" for column, unit in source.columns.items())
                    raise EventError(f"sensors.{name}: found {found} columns, expected {expected}: {columns}")
    elif isinstance(event, Scan):
        source = sources.get(event.source)
        if source is not None and source.shape == "readings":
            declared = sorted(source.columns.keys() - {"rssi_dbm"})
            if sorted(event.values) != declared:
                found_columns, columns = ", ".join(sorted(event.values)) or "none", ", ".join(declared) or "none"
                raise EventError(f"values: found {found_columns} in a scan of {event.source}, expected {columns}")
