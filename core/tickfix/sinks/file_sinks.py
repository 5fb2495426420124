"""Sinks that write estimates to files, JSON Lines or GeoJSON, and the choice of a sink by the suffix of a file.

A sink is a plugin class of kind ``sink`` that is built with a path, takes estimates one by one and is closed. Both
sinks here write to a temporary file beside their own and rename it when closed, so that an interrupted run never leaves
half a file.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, ClassVar, Self

import msgspec
import numpy as np

from tickfix.api import Belief, ConfigError, Estimate, Floats, PluginError
from tickfix.registry import Offer, Registry


def _plain_scalar(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"estimates hold numbers and strings, found {type(value).__name__}")


# msgspec writes floats in the shortest form that reads back the same, and those that are not finite as null.
_encode = msgspec.json.Encoder(enc_hook=_plain_scalar).encode


class _FileSink:
    """A file that appears when it is complete."""

    kind: ClassVar[str] = "sink"
    name: ClassVar[str]
    source: ClassVar[str] = ""
    suffixes: ClassVar[tuple[str, ...]]

    def __init__(self, path: Path) -> None:
        """Open a sibling of ``path``; folders that are missing are made.

        Raises:
            OSError: when the place cannot be written.
        """
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        self._partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
        self._file = self._partial.open("wb")

    def close(self) -> None:
        """Complete the file and put it in its place; a second call does nothing."""
        if self._file.closed:
            return
        try:
            self._finish()
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()
            self._partial.replace(self.path)
        except BaseException:
            self.discard()
            raise

    def discard(self) -> None:
        """Give up: leave no file, and one that was there before as it was."""
        self._file.close()
        self._partial.unlink(missing_ok=True)

    def _finish(self) -> None:
        """Write what stands at the end."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
        else:
            self.discard()


class JsonLinesSink(_FileSink):
    """One JSON object a line and estimate, whatever its status.

    Keys are those of :class:`~tickfix.api.Estimate` and :class:`~tickfix.api.Belief` with the mean as ``x_m`` and
    ``y_m`` (floor frame) and the covariance as ``covariance_m2``, row by row; those of the belief are null without one.
    ``diagnostics`` is left out where there are none.
    """

    name: ClassVar[str] = "json-lines"
    suffixes: ClassVar[tuple[str, ...]] = (".jsonl", ".ndjson")

    def write(self, estimate: Estimate) -> None:
        """Append a line."""
        self._file.write(_encode(_estimate_fields(estimate) | _belief_fields(estimate.belief)) + b"\n")


class GeoJsonSink(_FileSink):
    """A GeoJSON FeatureCollection in floor metres, see :class:`GeoJsonWriter`."""

    name: ClassVar[str] = "geojson"
    suffixes: ClassVar[tuple[str, ...]] = (".geojson", ".json")

    def __init__(self, path: Path) -> None:
        """Open the collection."""
        super().__init__(path)
        self._writer = GeoJsonWriter(self._file)

    def write(self, estimate: Estimate) -> None:
        """Append a Point."""
        self._writer.write(estimate)

    def _finish(self) -> None:
        self._writer.finish()


class GeoJsonWriter:
    """Writes a GeoJSON FeatureCollection (RFC 7946): a Point for each estimate, then the tracks as LineStrings.

    Coordinates are metres in the floor's frame and not degrees, as the member ``coordinate_reference`` says. An
    estimate without a position is left out. There is one LineString per device and pipeline, through the newest
    revision of each tick; where the track changes its floor, or the device's clock its epoch, another one begins, since
    a line can lie in one frame only. The tracks are kept in memory until :meth:`finish`.
    """

    def __init__(self, file: BinaryIO) -> None:
        """Begin the collection in ``file``."""
        reference = {
            "frame": "floor",
            "unit": "metre",
            "axes": ["x east", "y north"],
            "note": "Coordinates are metres in the frame of the floor that each feature names, not degrees.",
        }
        self._file = file
        self._file.write(b'{"type":"FeatureCollection","coordinate_reference":' + _encode(reference) + b',"features":[')
        self._separator = b"\n"
        self._tracks: dict[tuple[str, str], dict[tuple[int, int], tuple[int, str, list[float]]]] = {}

    def write(self, estimate: Estimate) -> None:
        """Append a Point."""
        belief = estimate.belief
        if belief is None or not np.isfinite(belief.xy).all():
            return
        xy = belief.xy.tolist()
        self._feature("Point", xy, _estimate_fields(estimate) | _belief_fields(belief))
        track = self._tracks.setdefault((estimate.device, estimate.pipeline), {})
        instant = (estimate.epoch, estimate.tick)
        if instant not in track or track[instant][0] <= estimate.revision:
            track[instant] = (estimate.revision, belief.floor, xy)

    def finish(self) -> None:
        """Append the LineStrings and end the collection."""
        for (device, pipeline), track in self._tracks.items():
            for (epoch, floor), places in groupby(sorted(track.items()), key=lambda item: (item[0][0], item[1][1])):
                line = [xy for _, (_, _, xy) in places]
                if len(line) > 1:
                    names = {"device": device, "pipeline": pipeline, "epoch": epoch, "floor": floor}
                    self._feature("LineString", line, names)
        self._file.write(b"\n]}\n")

    def _feature(self, geometry: str, coordinates: list[Any], properties: dict[str, Any]) -> None:
        feature = {
            "type": "Feature",
            "geometry": {"type": geometry, "coordinates": coordinates},
            "properties": properties,
        }
        self._file.write(self._separator + _encode(feature))
        self._separator = b",\n"


def _estimate_fields(estimate: Estimate) -> dict[str, Any]:
    return {
        "device": estimate.device,
        "pipeline": estimate.pipeline,
        "epoch": estimate.epoch,
        "tick": estimate.tick,
        "t_ns": estimate.t_ns,
        "revision": estimate.revision,
        "status": estimate.status.value,
        "motion_age_ns": estimate.motion_age_ns,
        "observation_age_ns": estimate.observation_age_ns,
        "innovation_m": estimate.innovation_m,
        "nis": estimate.nis,
        "failed_by": estimate.failed_by,
        "reasons": list(estimate.reasons),
        **({"diagnostics": dict(estimate.diagnostics)} if estimate.diagnostics else {}),
    }


def _belief_fields(belief: Belief | None) -> dict[str, Any]:
    if belief is None:
        return dict.fromkeys(
            ("floor", "x_m", "y_m", "covariance_m2", "floor_probabilities", "mixture", "speed_mps", "heading_rad")
        )
    return {
        **_gaussian(belief.floor, belief.xy, belief.covariance),
        "floor_probabilities": dict(belief.floor_probabilities) or {belief.floor: 1.0},
        "mixture": [{"weight": c.weight, **_gaussian(c.floor, c.xy, c.covariance)} for c in belief.mixture],
        "speed_mps": belief.speed_mps,
        "heading_rad": belief.heading_rad,
    }


def _gaussian(floor: str, xy: Floats, covariance: Floats) -> dict[str, Any]:
    x, y = xy.tolist()
    return {"floor": floor, "x_m": x, "y_m": y, "covariance_m2": covariance.tolist()}


def sink_for(path: Path, plugins: Registry) -> Offer:
    """Return the sink for files like ``path``.

    Raises:
        ConfigError: listing the suffixes there are.
    """
    known: dict[str, Offer] = {}
    for offer in plugins.of_kind("sink"):
        for suffix in getattr(offer.cls, "suffixes", ()):
            known.setdefault(suffix, offer)
    if path.suffix.lower() not in known:
        expected = ", ".join(f"{suffix} ({offer.name})" for suffix, offer in sorted(known.items()))
        raise ConfigError(f"--out {path}", f"suffix {path.suffix!r}", f"one of {expected or 'none: no sink is there'}")
    return known[path.suffix.lower()]


@dataclass(frozen=True, slots=True)
class SinkTarget:
    """A file and the sink that writes it."""

    offer: Offer
    path: Path


@contextmanager
def open_sink(target: SinkTarget) -> Iterator[Callable[[Estimate], None]]:
    """Open the sink, give its ``write``, and close it; after an error it is told to discard, where it can.

    Raises:
        PluginError: when it cannot be opened.
    """
    try:
        sink = target.offer.cls(target.path)
    except Exception as error:
        raise PluginError(target.offer.label, f"cannot write {target.path}: {error}", "Choose another --out") from error
    try:
        yield sink.write
    except BaseException:
        getattr(sink, "discard", sink.close)()
        raise
    sink.close()
