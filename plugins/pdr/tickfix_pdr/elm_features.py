"""Features, labels and outputs of windows for pdr ``elm``, [jiang2015] section 4.

Features are means over a window, eq. (3). The orientation is the mean rotation vector as Android's azimuth, pitch and
roll; the mean is taken of the vector, since angles jump at ±180°. Labels come from cubic splines through the waypoints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from tickfix.api import Floats, Ints, MotionSamples, SurveyWalk, frozen, wrap_rad
from tickfix.toolkit.calibration import samples_between

_MAX_SPEED_MPS = 3.0  # nobody runs faster indoors; a network's output is arbitrary for inputs unlike its training
_MIN_HEADING_SPEED_MPS = 0.2  # below it the spline's direction is that of its error


@dataclass(frozen=True, slots=True, eq=False)
class LabelledWindows:
    """Windows of surveyed walks; those without all features or without a direction are left out.

    Attributes:
        x: (N, n) features.
        t: (N,) labels: metres a second, or heading in radians.
        walk: (N,) number of the walk.
    """

    x: Floats
    t: Floats
    walk: Ints


@dataclass(frozen=True, slots=True, eq=False)
class SensorSums:
    """Sums of samples, of which the means over any number of ticks are made, eq. (3).

    Attributes:
        sums: (13,) of accelerometer, gyroscope and magnetometer, three each, and of the rotation vector's quaternion,
            whose signs are chosen alike.
        counts: (4,) samples of each, in that order.
    """

    sums: Floats
    counts: Floats


def sum_samples(samples: MotionSamples) -> SensorSums:
    """Return the sums over a tick, or over any span."""
    sums, counts = np.zeros(13), np.zeros(4)
    for i, name in enumerate(("accelerometer", "gyroscope", "magnetometer")):
        sensor = samples.sensors.get(name)
        if sensor is not None:
            sums[3 * i : 3 * i + 3], counts[i] = sensor.values.sum(axis=0), len(sensor)
    rotation = samples.sensors.get("rotation_vector")
    if rotation is not None:
        q = (
            rotation.values * np.where(rotation.values @ rotation.values[0] < 0.0, -1.0, 1.0)[:, None]
        )  # q and −q are one
        sums[9:], counts[3] = q.sum(axis=0), len(rotation)
    return SensorSums(frozen(sums), frozen(counts))


def merge_sums(parts: Sequence[SensorSums]) -> SensorSums:
    """Return the sums over a window of at least one tick."""
    if len(parts) == 1:
        return parts[0]
    sums = np.array([part.sums for part in parts])
    first = sums[np.argmax(np.abs(sums[:, 9:]).sum(axis=1) > 0.0), 9:]
    sums[sums[:, 9:] @ first < 0.0, 9:] *= -1.0
    return SensorSums(frozen(sums.sum(axis=0)), frozen(np.sum([part.counts for part in parts], axis=0)))


def velocity_features(window: SensorSums) -> Floats | None:
    """Return acc.x, y, z, gyr.x, y, z (6,), eq. (1); None without samples of a sensor."""
    if not window.counts[:2].all():
        return None
    means: Floats = window.sums[:6] / np.repeat(window.counts[:2], 3)  # eq. (3)
    return means


def heading_features(window: SensorSums, *, as_vector: bool) -> Floats | None:
    """Return ori.x, y, z in radians and mag.x, y, z in µT (6,), eq. (2); None without samples of a sensor.

    ``as_vector``: ori.x as its sine and cosine (7,), so that what is felt does not jump where the azimuth does.
    """
    norm = float(np.linalg.norm(window.sums[9:]))
    if not window.counts[2:].all() or norm == 0.0:
        return None
    x, y, z, w = window.sums[9:] / norm
    azimuth = np.arctan2(2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z))
    pitch = np.arcsin(np.clip(-2.0 * (y * z + x * w), -1.0, 1.0))
    roll = np.arctan2(-2.0 * (x * z - y * w), 1.0 - 2.0 * (x * x + y * y))
    turned = [np.sin(azimuth), np.cos(azimuth)] if as_vector else [azimuth]
    return np.concatenate([[*turned, pitch, roll], window.sums[6:9] / window.counts[2]])


def velocities_of_outputs(outputs: Floats) -> Floats:
    """Return metres a second (N,) of outputs (N, 1)."""
    return np.clip(outputs[:, 0], 0.0, _MAX_SPEED_MPS)


def headings_of_outputs(outputs: Floats) -> Floats:
    """Return headings (N,) of outputs (N, 2), sine and cosine, or (N, 1), angles."""
    return np.arctan2(outputs[:, 0], outputs[:, 1]) if outputs.shape[1] == 2 else wrap_rad(outputs[:, 0])


def labelled_windows(
    walks: tuple[SurveyWalk, ...], window_ns: int, *, as_vector: bool
) -> tuple[LabelledWindows, LabelledWindows]:
    """Return the windows for the velocity and for the heading of walks, of ``window_ns`` nanoseconds each."""
    rows: tuple[list[tuple[Floats, float, int]], ...] = ([], [])
    for number, walk in enumerate(walks):
        t_ns, first = np.unique([truth.t_ns for truth in walk.truth], return_index=True)
        if len(t_ns) < 2:
            continue
        xy = np.array([truth.xy for truth in walk.truth])[first]
        t0_ns = int(t_ns[0])
        spline = CubicSpline((t_ns - t0_ns) * 1e-9, xy, bc_type="natural")
        for start_ns in range(t0_ns, int(t_ns[-1]) - window_ns + 1, window_ns):
            samples = samples_between(walk.motion, start_ns, start_ns + window_ns)
            t_s = (start_ns - t0_ns + np.array([0, window_ns])) * 1e-9
            east, north = np.diff(spline(t_s), axis=0)[0] / (window_ns * 1e-9)
            v = float(np.hypot(east, north))
            window = sum_samples(samples)
            moved, pointed = velocity_features(window), heading_features(window, as_vector=as_vector)
            if moved is not None:
                rows[0].append((moved, v, number))
            if pointed is not None and v >= _MIN_HEADING_SPEED_MPS:
                rows[1].append((pointed, float(np.arctan2(east, north)), number))
    velocity, heading = (_stack_windows(found) for found in rows)
    return velocity, heading


def assign_folds(walk: Ints, chain: Ints, count: int, *, keep_chains: bool, rng: np.random.Generator) -> Ints:
    """Return the fold (N,) of each window: whole chains in turn, or windows at random.

    With a single chain its windows are cut into consecutive blocks: neighbours still stay together.
    """
    n = len(walk)
    count = min(count, n)
    if not keep_chains:
        shuffled: Ints = rng.permutation(n) % count
        return shuffled
    present = np.unique(chain[walk])
    if len(present) < 2:
        return np.arange(n) * count // n
    return np.searchsorted(present, chain[walk]) % min(count, len(present))


def _stack_windows(rows: list[tuple[Floats, float, int]]) -> LabelledWindows:
    if not rows:
        return LabelledWindows(np.zeros((0, 0)), np.zeros(0), np.zeros(0, np.int64))
    return LabelledWindows(
        np.array([x for x, _, _ in rows]), np.array([t for _, t, _ in rows]), np.array([w for *_, w in rows])
    )
