"""A track (the estimates of one pipeline for one device, tick by tick) and its SHA-256 digest."""

from __future__ import annotations

import base64
import hashlib
import html
import io
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import msgpack
import msgspec
import numpy as np
from numpy.typing import NDArray

from tickfix.api import Belief, Bools, Component, Estimate, Fix, Floats, Floor, Ints, Truth
from tickfix.api.arrays import frozen_ints
from tickfix.sinks.file_sinks import GeoJsonWriter

if TYPE_CHECKING:
    from pandas import DataFrame

    from tickfix.evaluation.theme import NotebookFigure


DiagnosticSums: TypeAlias = Mapping[str, tuple[float, int]]
"""By the name of a diagnostic, the sum over the estimates that report it, and how many do."""

TRACK_DTYPE: Final = np.dtype(
    [
        ("t_ns", np.int64),
        ("closed_ns", np.int64),
        ("epoch", np.int64),
        ("tick", np.int64),
        ("revision", np.int64),
        ("status", "U12"),
        ("floor", "U0"),
        ("x_m", np.float64),
        ("y_m", np.float64),
        ("var_x_m2", np.float64),
        ("cov_xy_m2", np.float64),
        ("var_y_m2", np.float64),
        ("speed_mps", np.float64),
        ("heading_rad", np.float64),
        ("innovation_m", np.float64),
        ("nis", np.float64),
    ]
)
"""Columns of :meth:`Track.to_numpy` and :meth:`Track.to_pandas`; ``floor`` is as wide as the longest name."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class Track:
    """The estimates of one pipeline for one device: as published at the time (causal), or final (fixed-lag).

    Attributes:
        pipeline, device: which pipeline followed which device.
        estimates: n estimates in the order of (epoch, tick), each tick once.
        closed_ns: (n,) int64, non-decreasing: arrival time of the event that closed each tick, which is when its
            estimate was known.
        truth: waypoints of the walk in time order, where they are known; :attr:`errors` needs them.
        floors: plans to draw the track on.
        fixes: what the pipeline's fingerprint found, for pictures.
    """

    pipeline: str
    device: str
    estimates: tuple[Estimate, ...]
    closed_ns: Ints
    truth: tuple[Truth, ...] = ()
    floors: tuple[Floor, ...] = ()
    fixes: tuple[Fix, ...] = ()

    def __post_init__(self) -> None:
        """Freeze the times and check the order.

        Raises:
            EventError: when ``closed_ns`` has another length or holds no integers.
            ValueError: when ticks, or the times at which they closed, run backwards.
        """
        object.__setattr__(self, "estimates", tuple(self.estimates))
        object.__setattr__(self, "closed_ns", frozen_ints("closed_ns", self.closed_ns, len(self.estimates)))
        object.__setattr__(self, "truth", tuple(sorted(self.truth, key=lambda waypoint: waypoint.t_ns)))
        backwards = np.flatnonzero(self.closed_ns[1:] < self.closed_ns[:-1])
        if backwards.size:
            raise ValueError(f"closed_ns: found a smaller time at index {backwards[0] + 1}, ticks close in their order")
        instants = [(estimate.epoch, estimate.tick) for estimate in self.estimates]
        for i, (before, after) in enumerate(pairwise(instants), start=1):
            if after <= before:
                raise ValueError(f"estimates: found (epoch, tick) {after} at index {i}, expected one after {before}")

    @staticmethod
    def of(pipeline: str, device: str, published: Iterable[tuple[Estimate, int]]) -> Track:
        """Return the track of pairs (estimate, time at which its tick closed), as a driver collects them."""
        pairs = tuple(published)
        closed_ns = np.array([closed for _, closed in pairs], dtype=np.int64)
        return Track(pipeline=pipeline, device=device, estimates=tuple(e for e, _ in pairs), closed_ns=closed_ns)

    def __len__(self) -> int:
        """Return the number of ticks."""
        return len(self.estimates)

    def __iter__(self) -> Iterator[Estimate]:
        """Iterate over the estimates."""
        return iter(self.estimates)

    def belief_at(self, t_ns: int) -> Belief | None:
        """Return what was known at ``t_ns``: the belief of the last tick that had closed by then.

        Returns None before the first tick closed, and where that tick's estimate has no belief or one that is not
        finite; an older belief is not used instead.
        """
        i = int(np.searchsorted(self.closed_ns, t_ns, side="right")) - 1
        belief = self.estimates[i].belief if i >= 0 else None
        return belief if belief is not None and np.isfinite(belief.xy).all() else None

    @property
    def errors(self) -> Floats:
        """(m,) float64, metres: horizontal distance from each waypoint to what was known at its time.

        NaN where there was no estimate; empty for a walk without waypoints. On a wrong floor it is the distance of the
        coordinates, each in its own floor's frame.
        """
        return waypoint_errors(self, self.truth)[0]

    def to_numpy(self) -> NDArray[np.void]:
        """Return (n,) a structured array with the columns of :data:`TRACK_DTYPE`, NaN where there is no value.

        Coordinates are metres in the frame of ``floor``, which is empty where there is no position; headings are
        radians clockwise from +y.
        """
        width = max((len(e.belief.floor) for e in self.estimates if e.belief is not None), default=1)
        columns = [(n, f"U{width}" if n == "floor" else TRACK_DTYPE[n]) for n in TRACK_DTYPE.names or ()]
        rows = np.zeros(len(self), dtype=columns)
        for name in ("x_m", "y_m", "var_x_m2", "cov_xy_m2", "var_y_m2", "speed_mps", "heading_rad"):
            rows[name] = np.nan
        for name in ("t_ns", "epoch", "tick", "revision", "status"):
            rows[name] = [getattr(estimate, name) for estimate in self.estimates]
        for name in ("innovation_m", "nis"):
            rows[name] = [np.nan if (v := getattr(e, name)) is None else v for e in self.estimates]
        rows["closed_ns"] = self.closed_ns
        for row, estimate in zip(rows, self.estimates, strict=True):
            belief = estimate.belief
            if belief is None:
                continue
            row["floor"] = belief.floor
            row["x_m"], row["y_m"] = belief.xy
            row["var_x_m2"], row["cov_xy_m2"], row["var_y_m2"] = belief.covariance[[0, 0, 1], [0, 1, 1]]
            for name in ("speed_mps", "heading_rad"):
                value = getattr(belief, name)
                row[name] = np.nan if value is None else value
        return rows

    def to_pandas(self) -> DataFrame:
        """Return a frame of the columns of :meth:`to_numpy`, indexed by ``time``, a timestamp in UTC.

        Raises:
            ImportError: when pandas is not installed; the extra ``tickfix[pandas]`` brings it.
        """
        try:
            import pandas as pd  # noqa: PLC0415 - optional, and slow to import
        except ImportError as error:
            raise ImportError("Track.to_pandas needs pandas: pip install 'tickfix[pandas]'") from error
        frame = pd.DataFrame(self.to_numpy())
        frame.index = pd.DatetimeIndex(pd.to_datetime(frame["t_ns"], unit="ns", utc=True), name="time")
        return frame

    def to_geojson(self, path: str | PathLike[str] | None = None) -> dict[str, Any]:
        """Return the track as a GeoJSON FeatureCollection in floor metres, and write it to ``path`` where given.

        It is what ``tickfix replay --out track.geojson`` writes, see :class:`tickfix.sinks.GeoJsonWriter`.
        """
        buffer = io.BytesIO()
        writer = GeoJsonWriter(buffer)
        for estimate in self.estimates:
            writer.write(estimate)
        writer.finish()
        if path is not None:
            Path(path).write_bytes(buffer.getvalue())
        collection: dict[str, Any] = msgspec.json.decode(buffer.getvalue())
        return collection

    def plot(self, path: str | PathLike[str] | None = None, *, floor: str | None = None) -> NotebookFigure:
        """Draw the track on a floor's plan, with waypoints, fixes and 95 % regions where they are known.

        Args:
            path: where to write the picture, ``.png`` or ``.svg``, besides returning it.
            floor: name of the floor to draw; by default the one with most waypoints, else with most estimates.

        Returns:
            A matplotlib figure, which a notebook shows.

        Raises:
            ValueError: for another suffix of ``path``, or a floor that is neither known nor visited.
        """
        from tickfix.evaluation.pictures import walk_figure  # noqa: PLC0415 - matplotlib is slow to import
        from tickfix.evaluation.theme import save_figure  # noqa: PLC0415

        title = self.device if len(self._visited_floors()) < 2 else f"{self.device}, {self._drawn_floor(floor).name}"
        figure = walk_figure(self._drawn_floor(floor), self.truth, {self.pipeline: self}, self.fixes, title=title)
        if path is not None:
            save_figure(figure, Path(path))
        return figure

    def __repr__(self) -> str:
        """Return one line: which track, how long, and how far off where that is known."""
        parts = [f"{len(self)} estimates"]
        if self.truth:
            known = self.errors[np.isfinite(self.errors)]
            median = f", median error {np.median(known):.2f} m" if len(known) else ""
            parts.append(f"{len(known)} of {len(self.truth)} waypoints{median}")
        return f"<Track {self.pipeline!r} of {self.device!r}: {'; '.join(parts)}>"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the line of :meth:`__repr__` above the picture."""
        picture = base64.b64encode(self.plot()._repr_png_()).decode("ascii")
        return f'<p>{html.escape(repr(self))}</p><img src="data:image/png;base64,{picture}" style="max-width: 100%">'

    def _visited_floors(self) -> Counter[str]:
        """Return how often each floor occurs among the waypoints, or among the estimates of a walk without any."""
        beliefs = [estimate.belief for estimate in self.estimates]
        return Counter(waypoint.floor for waypoint in self.truth) or Counter(b.floor for b in beliefs if b is not None)

    def _drawn_floor(self, name: str | None) -> Floor:
        visited = self._visited_floors()
        wanted = name if name is not None else next((floor for floor, _ in visited.most_common(1)), "")
        for floor in self.floors:
            if floor.name == wanted:
                return floor
        if name is not None and name not in visited:
            known = ", ".join(sorted({*visited, *(floor.name for floor in self.floors)}))
            raise ValueError(f"floor: found {name!r}, expected one of {known or 'none: the track has no position'}")
        return Floor(name=wanted)


def waypoint_errors(track: Track, waypoints: Sequence[Truth]) -> tuple[Floats, Bools]:
    """Return how far off a track was at m waypoints, and whether it named their floor.

    Returns:
        ``error_m`` (m,) float64, metres, NaN where there was no estimate; ``floor_right`` (m,) bool, False there.
    """
    error_m = np.full(len(waypoints), np.nan)
    floor_right = np.zeros(len(waypoints), dtype=np.bool_)
    for i, waypoint in enumerate(waypoints):
        belief = track.belief_at(waypoint.t_ns)
        if belief is not None:
            error_m[i] = np.hypot(*(belief.xy - waypoint.xy))
            floor_right[i] = belief.floor == waypoint.floor
    return error_m, floor_right


def sum_diagnostics(track: Iterable[Estimate]) -> DiagnosticSums:
    """Return the sums of what the estimates of a track report about their filter, by name."""
    values: dict[str, list[float]] = {}
    for estimate in track:
        for name, value in estimate.diagnostics.items():
            values.setdefault(name, []).append(value)
    return {name: (math.fsum(found), len(found)) for name, found in sorted(values.items())}


def digest(track: Iterable[Estimate]) -> str:
    """Return the SHA-256 (64 hex digits) of what a track, or its estimates in tick order, says, bit for bit.

    Hashed is the MessagePack of each estimate in turn, floats and arrays as their 8 IEEE 754 bytes. Left out are the
    pipeline's name, so that two names of one algorithm agree, and the revision: how often a tick was revised tells of
    the order of arrival, on which a settled track must not depend. ``closed_ns`` is left out for the same reason, and
    diagnostics, since they describe how an estimate came about and are no part of it.
    """
    sha = hashlib.sha256()
    packer = msgpack.Packer(use_bin_type=True, unicode_errors="surrogatepass")
    for estimate in track:
        sha.update(packer.pack(_digest_content(estimate)))
    return sha.hexdigest()


def pooled_digest(digests: Iterable[str]) -> str:
    """Return one digest for those of several walks, taken in the order of the walks: SHA-256 of their bytes joined."""
    return hashlib.sha256(b"".join(bytes.fromhex(one) for one in digests)).hexdigest()


def _digest_content(estimate: Estimate) -> tuple[Any, ...]:
    return (
        estimate.device,
        int(estimate.epoch),
        int(estimate.tick),
        int(estimate.t_ns),
        str(estimate.status),
        None if estimate.belief is None else _belief_content(estimate.belief),
        _plain_int(estimate.motion_age_ns),
        _plain_int(estimate.observation_age_ns),
        _plain_float(estimate.innovation_m),
        _plain_float(estimate.nis),
        estimate.failed_by,
        tuple(estimate.reasons),
    )


def _belief_content(belief: Belief) -> tuple[Any, ...]:
    return (
        belief.floor,
        _float64_bytes(belief.xy),
        _float64_bytes(belief.covariance),
        tuple((floor, float(probability)) for floor, probability in belief.floor_probabilities),
        tuple(_component_content(component) for component in belief.mixture),
        _plain_float(belief.speed_mps),
        _plain_float(belief.heading_rad),
    )


def _component_content(component: Component) -> tuple[Any, ...]:
    return float(component.weight), component.floor, _float64_bytes(component.xy), _float64_bytes(component.covariance)


def _float64_bytes(array: Floats) -> bytes:
    return np.asarray(array, dtype="<f8").tobytes()


def _plain_int(value: int | None) -> int | None:
    return None if value is None else int(value)


def _plain_float(value: float | None) -> float | None:
    return None if value is None else float(value)
