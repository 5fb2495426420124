"""Recordings for the Python face: read from files, or built from arrays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from tickfix.api import (
    SENSORS,
    TICK_NS,
    ConfigError,
    Event,
    EventError,
    Floats,
    Ints,
    MotionSamples,
    ReaderError,
    Recording,
    Samples,
    Scan,
    Truth,
)
from tickfix.replay.recording_files import LoadedRecording, RecordingFile, find_recordings
from tickfix.site import HeldOutWalk, Site
from tickfix.workflow.pipelines import installed, warn_each

WalkSource: TypeAlias = Recording | HeldOutWalk | str | PathLike[str]
"""A recording, a file or folder of recordings, or a walk that a survey held out."""

SensorData: TypeAlias = ArrayLike | tuple[ArrayLike, ArrayLike]

_NS_PER_S: Final = 1e9


def read(path: str | PathLike[str]) -> Recording:
    """Read one recording with the reader that recognises it.

    Args:
        path: a file, or a folder that holds one recording.

    Raises:
        ReaderError: when there is none, when there are several, or when nothing of it can be read.
    """
    sources = find_walks([path])
    if len(sources) != 1:
        raise ReaderError(f"{path}: found {len(sources)} recordings, expected one; read_all reads them all")
    return sources[0].read()


def read_all(paths: WalkSource | Iterable[WalkSource]) -> tuple[Recording, ...]:
    """Read all recordings at ``paths``, files or folders, in the order of their paths.

    Raises:
        ReaderError: when there is none, or one cannot be read.
    """
    return tuple(source.read() for source in find_walks(paths))


def find_walks(walks: WalkSource | Iterable[WalkSource]) -> tuple[RecordingFile | LoadedRecording, ...]:
    """Return the recordings that ``walks`` name, each once; files are not read yet.

    Raises:
        ReaderError: for a path that does not exist or that no reader recognises.
        SiteError: when a walk that was held out is gone or has changed.
    """
    given = [walks] if isinstance(walks, (Recording, HeldOutWalk, str, PathLike)) else list(walks)
    found: list[RecordingFile | LoadedRecording] = []
    for walk in given:
        if isinstance(walk, Recording):
            found.append(LoadedRecording(walk))
            continue
        files = find_recordings([walk.file() if isinstance(walk, HeldOutWalk) else Path(walk)], installed())
        warn_each(files.problems)
        known = {source.path.resolve() for source in found if isinstance(source, RecordingFile)}
        found += [source for source in files.sources if source.path.resolve() not in known]
    return tuple(found)


def check_walks(where: str, sources: Sequence[RecordingFile | LoadedRecording], site: Site) -> tuple[str, ...]:
    """Check the walks to be evaluated on a site.

    Returns:
        Sentences to warn with, where walks are part of the site's survey.

    Raises:
        ConfigError: naming ``where`` the walks were given, when two share a name.
    """
    names = [_walk_name(source) for source in sources]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ConfigError(where, f"several walks called {twice[0]!r}", "walks with different names")
    surveyed = {track.walk for track in site.survey_tracks}
    known = [name for name in names if name in surveyed]
    if not known:
        return ()
    others = " and others" if len(known) > 1 else ""
    return (f"{known[0]}{others}: part of the survey, which flatters the errors: the site has learnt from it",)


def _walk_name(source: RecordingFile | LoadedRecording) -> str:
    if isinstance(source, LoadedRecording):
        return source.recording.name
    name = source.path.name
    return name.removesuffix(".gz").rpartition(".")[0] or name


def recording(
    *,
    accelerometer: SensorData | None = None,
    gyroscope: SensorData | None = None,
    magnetometer: SensorData | None = None,
    rotation_vector: SensorData | None = None,
    pressure: SensorData | None = None,
    scans: Iterable[Scan | tuple[float, Mapping[str, float]]] = (),
    waypoints: Iterable[Truth | Sequence[Any]] = (),
    floor: str = "",
    name: str = "walk",
) -> Recording:
    """Build a recording from arrays, as if everything had arrived when it was measured.

    Times are seconds where they are floats, and nanoseconds where they are integers, on one clock for all.

    Args:
        accelerometer: (n, 4) float64, time and x, y, z; or times (n,) and values (n, 3). m/s², device frame, gravity
            included.
        gyroscope: the same in rad/s.
        magnetometer: the same in µT.
        rotation_vector: time and unit quaternion x, y, z, w from device to east-north-up.
        pressure: time and hPa.
        scans: :class:`~tickfix.api.Scan` objects, or pairs (time, {transmitter: dBm}).
        waypoints: where the device truly was: rows (time, x, y) in metres on ``floor``, rows (time, x, y, floor), or
            :class:`~tickfix.api.Truth` objects. Trackers never see them.
        floor: name of the floor that was walked on; empty for a walk over several.
        name: of the recording, and of the device.

    Raises:
        EventError: when an array has the wrong shape, or times run backwards.

    >>> import numpy as np, tickfix
    >>> t = np.arange(0.0, 10.0, 0.02)
    >>> still = np.column_stack([t, 0 * t, 0 * t, 0 * t + 9.81])
    >>> walk = tickfix.recording(accelerometer=still, scans=[(1.0, {"ap1": -50.0})], waypoints=[(2.0, 0.0, 0.0)],
    ...                          floor="F1")
    >>> sum(len(event) for event in walk.events if hasattr(event, "sensors")), walk.truth[0].floor
    (500, 'F1')
    """
    given = {
        "accelerometer": accelerometer,
        "gyroscope": gyroscope,
        "magnetometer": magnetometer,
        "rotation_vector": rotation_vector,
        "pressure": pressure,
    }
    samples = {sensor: _samples(sensor, data) for sensor, data in given.items() if data is not None}
    events: list[Event] = [*_batches(samples, name)]
    events += [_scan(scan, name) for scan in scans]
    # Truth counts on after what trackers see, so that leaving it out leaves no gap in the numbers.
    events = sorted(events, key=lambda event: event.arrival_ns)
    events += sorted((_truth(waypoint, floor, name) for waypoint in waypoints), key=lambda event: event.arrival_ns)
    numbered = [replace(event, seq=seq, session=name) for seq, event in enumerate(events)]
    return Recording(name=name, floor=floor, events=tuple(sorted(numbered, key=lambda event: event.arrival_ns)))


def _samples(sensor: str, data: SensorData) -> Samples:
    columns, unit = SENSORS[sensor]
    if isinstance(data, tuple):
        times, values = np.asarray(data[0]), np.asarray(data[1], dtype=np.float64)
    else:
        rows = np.asarray(data)
        if rows.ndim != 2 or rows.shape[1] != columns + 1:
            raise EventError(f"{sensor}: found shape {rows.shape}, expected (n, {columns + 1}): time and {unit}")
        times, values = rows[:, 0], np.asarray(rows[:, 1:], dtype=np.float64)
    if values.ndim == 1 and columns == 1:
        values = values[:, np.newaxis]
    if times.ndim != 1 or values.shape != (len(times), columns):
        raise EventError(
            f"{sensor}: found times {times.shape} and values {values.shape}, expected (n,) and (n, {columns})"
        )
    t_ns = _nanoseconds(times)
    if backwards := np.flatnonzero(np.diff(t_ns) < 0).tolist():
        raise EventError(f"{sensor}: found a smaller time at index {backwards[0] + 1}, times may not run backwards")
    return Samples(t_ns, values)


def _nanoseconds(times: Any) -> Ints:
    array = np.asarray(times)
    whole: Floats | Ints = array if array.dtype.kind in "iu" else np.round(array.astype(np.float64) * _NS_PER_S)
    return whole.astype(np.int64)


def _batches(samples: Mapping[str, Samples], device: str) -> list[MotionSamples]:
    """Return a message per tick, so that no estimate waits for samples of later ticks."""
    if not samples:
        return []
    ticks = {sensor: -(-one.t_ns // TICK_NS) for sensor, one in samples.items()}
    batches = []
    for tick in np.unique(np.concatenate(list(ticks.values()))):
        within = {sensor: np.searchsorted(at, [tick, tick + 1]) for sensor, at in ticks.items()}
        sensors = {
            sensor: Samples(samples[sensor].t_ns[a:b], samples[sensor].values[a:b])
            for sensor, (a, b) in within.items()
            if b > a
        }
        batches.append(MotionSamples(sensors=sensors, device=device))
    return batches


def _scan(scan: Scan | tuple[float, Mapping[str, float]], device: str) -> Scan:
    if isinstance(scan, Scan):
        return replace(scan, device=device)
    time, readings = scan
    t_ns = int(_nanoseconds(time))
    return Scan(
        transmitters=tuple(readings),
        rssi_dbm=np.array(list(readings.values()), dtype=np.float64),
        heard_ns=np.full(len(readings), t_ns, dtype=np.int64),
        t_ns=t_ns,
        device=device,
    )


def _truth(waypoint: Truth | Sequence[Any], floor: str, device: str) -> Truth:
    if isinstance(waypoint, Truth):
        return replace(waypoint, device=device)
    if len(waypoint) not in (3, 4):
        raise EventError(f"waypoints: found {len(waypoint)} columns, expected (time, x, y) or (time, x, y, floor)")
    time, x, y, *named = waypoint
    xy = np.array([x, y], dtype=np.float64)
    return Truth(t_ns=int(_nanoseconds(time)), floor=str(named[0]) if named else floor, xy=xy, device=device)
