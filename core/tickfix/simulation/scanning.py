"""Wi-Fi scans as phones do them: they take seconds, come late, and repeat what was heard before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tickfix.api import Bools, Floats, Floor, Ints, Rng
from tickfix.simulation.radio import Radio
from tickfix.simulation.walker import Trajectory


@dataclass(frozen=True, slots=True, kw_only=True)
class Receiver:
    """The Wi-Fi of a phone.

    Attributes:
        gain_db: what it reads above or below the mean of all phones.
        sensitivity_dbm: below this nothing is heard.
        soft_db: above it, the chance of hearing an access point nears one over about so many dB.
        miss: chance of not hearing one however near: beacons collide.
        step_dbm: readings are multiples of this; 0 leaves them as they are.
        scan_s: shortest and longest scan.
        delivery_s: shortest and longest time from the last reading to the app's being told.
        pause_s: shortest and longest time from the end of a scan to the beginning of the next.
        stale_s: an access point not heard is reported with its last reading until that is so old; 0 for honest scans.
    """

    gain_db: float = 0.0
    sensitivity_dbm: float = -95.0
    soft_db: float = 4.0
    miss: float = 0.12
    step_dbm: float = 1.0
    scan_s: tuple[float, float] = (1.0, 4.5)
    delivery_s: tuple[float, float] = (0.1, 1.0)
    pause_s: tuple[float, float] = (0.0, 0.5)
    stale_s: float = 10.0


def draw_receiver(rng: Rng) -> Receiver:
    """Draw a phone's Wi-Fi: phones differ by some dB, and in how long they scan."""
    longest = float(rng.uniform(1.5, 4.5))
    return Receiver(
        gain_db=float(np.clip(rng.normal(0.0, 2.5), -6.0, 6.0)),
        sensitivity_dbm=float(rng.uniform(-96.0, -92.0)),
        scan_s=(max(1.0, longest - 1.5), longest),
    )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Heard:
    """What one scan reports.

    Attributes:
        begin_s, end_s: when the phone began and ended to listen.
        delivered_s: when it told.
        access_point: (n,) int64, numbers of the access points.
        rssi_dbm: (n,) float64.
        heard_s: (n,) float64; before ``begin_s`` for what it repeats.
    """

    begin_s: float
    end_s: float
    delivered_s: float
    access_point: Ints
    rssi_dbm: Floats
    heard_s: Floats


def scan(trajectory: Trajectory, floor: Floor, radio: Radio, receiver: Receiver, rng: Rng) -> tuple[Heard, ...]:
    """Scan throughout a walk; every access point is heard at its own time and place within a scan.

    Args:
        trajectory: where the phone is, and which way the person looks.
        floor: it is on.
        radio: the building's.
        receiver: the phone's.
        rng: draws the scans' times, fading and what is missed.

    Returns:
        The scans in order of time; the last one ends within the walk.
    """
    time_rng, fade_rng, hear_rng = rng.spawn(3)
    begin, end, delivered = _times(float(trajectory.t_s[-1]), receiver, time_rng)
    # The card dwells on a channel for about an eighth of the scan; the beacon falls somewhere into it.
    channel = np.array([ap.channel for ap in radio.access_points])
    share = np.clip(channel + time_rng.uniform(-0.06, 0.06, (len(begin), len(channel))), 0.0, 1.0)
    at = begin[:, None] + share * (end - begin)[:, None]
    dbm = radio.mean_dbm(floor, trajectory.xy_at(at), trajectory.heading_at(at))
    dbm += receiver.gain_db + _fading(at, radio, fade_rng)
    if receiver.step_dbm > 0:
        dbm = np.round(dbm / receiver.step_dbm) * receiver.step_dbm
    chance = (1.0 - receiver.miss) * -np.expm1(-np.maximum(dbm - receiver.sensitivity_dbm, 0.0) / receiver.soft_db)
    heard = hear_rng.random(dbm.shape) < chance
    last = _last_heard(heard)
    reports = []
    for k in range(len(begin)):
        aps = np.flatnonzero(last[k] >= 0)
        row = last[k, aps]
        fresh = (row == k) | (end[k] - at[row, aps] < receiver.stale_s)
        aps, row = aps[fresh], row[fresh]
        reports.append(
            Heard(
                begin_s=float(begin[k]),
                end_s=float(end[k]),
                delivered_s=float(delivered[k]),
                access_point=aps,
                rssi_dbm=dbm[row, aps],
                heard_s=at[row, aps],
            )
        )
    return tuple(reports)


def _times(duration_s: float, receiver: Receiver, rng: Rng) -> tuple[Floats, Floats, Floats]:
    most = int(duration_s / max(0.1, receiver.scan_s[0] + receiver.pause_s[0])) + 1
    length = rng.uniform(*receiver.scan_s, most)
    pause = rng.uniform(*receiver.pause_s, most)
    end = np.cumsum(length + pause)
    delivered = end + rng.uniform(*receiver.delivery_s, most)
    within = end < duration_s
    return (end - length)[within], end[within], delivered[within]


def _fading(at: Floats, radio: Radio, rng: Rng) -> Floats:
    """Return what changes from walk to walk, over seconds and from reading to reading: (scans, T) dB."""
    s = radio.settings
    shape = at.shape
    slow = rng.standard_normal(shape)
    keep = np.exp(-np.diff(at, axis=0) / s.fading_s)
    for k in range(1, shape[0]):
        slow[k] = keep[k - 1] * slow[k - 1] + np.sqrt(1.0 - keep[k - 1] ** 2) * slow[k]
    fading: Floats = (
        s.session_db * rng.standard_normal(shape[1]) + s.fading_db * slow + s.fast_db * rng.standard_normal(shape)
    )
    return fading


def _last_heard(heard: Bools) -> Ints:
    """Return the number of the scan in which each access point was last heard, −1 for never: (scans, T)."""
    number = np.where(heard, np.arange(len(heard))[:, None], -1)
    last: Ints = np.maximum.accumulate(number, axis=0) if len(number) else number
    return last
