"""Radio of a building: mean received power at any place (path loss, walls, floors, shadowing, body), and Wi-Fi scans
as phones do them, with fading, missed beacons, delay and stale readings.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tickfix.api import Bools, Floats, Floor, Ints, Rng
from tickfix.simulation.fields import RandomField, draw_field
from tickfix.simulation.floor_plans import barriers, count_wall_crossings
from tickfix.simulation.pedestrian import Trajectory

RECEIVER_HEIGHT_M: Final = 1.2
"""Height above its floor at which a phone is held."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AccessPoint:
    """One transmitter.

    Attributes:
        name: its id, as it stands in a scan.
        floor: name of the floor it hangs on.
        xy: metres, floor frame.
        height_m: above its floor.
        power_dbm: received at 1 m in the open.
        channel: when in a scan it is listened for: 0 at the beginning, 1 at the end.
    """

    name: str
    floor: str
    xy: tuple[float, float]
    height_m: float = 2.7
    power_dbm: float = -38.0
    channel: float = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Propagation:
    """Log-distance path loss with walls and floors counted (COST 231 multi-wall model) and shadowing.

    Attributes:
        exponent: of the path loss; walls are counted apart, so it stays near that of open space.
        wall_db: loss per wall.
        floor_db: loss of the first floor between; n floors lose ``floor_db · n^((n+2)/(n+1) − 0.46)`` (COST 231).
        shadowing_db: standard deviation of log-normal shadowing.
        shadowing_m: distance at which its correlation has fallen to 1/e (Gudmundson 1991).
        body_db: loss when the person stands between the phone and the access point, none when facing it.
        session_db: standard deviation per access point from one walk to another: doors, people, power control.
        fading_db: standard deviation of the slow fading within a walk.
        fading_s: time over which the slow fading decorrelates to 1/e.
        fast_db: standard deviation of what changes from one reading to the next.
        floor_height_m: from one level to the next.
    """

    exponent: float = 2.2
    wall_db: float = 3.5
    floor_db: float = 17.0
    shadowing_db: float = 4.0
    shadowing_m: float = 5.0
    body_db: float = 4.0
    session_db: float = 1.0
    fading_db: float = 2.0
    fading_s: float = 6.0
    fast_db: float = 1.5
    floor_height_m: float = 3.5


@dataclass(frozen=True, slots=True, eq=False)
class Radio:
    """The access points of a building and how far they reach.

    Attributes:
        settings: how the waves travel.
        floors: the building's floors.
        access_points: T of them; the columns of every array here.
        shadowing: one function of (x, y, height) per access point, so that all who come by see the same building.
    """

    settings: Propagation
    floors: tuple[Floor, ...]
    access_points: tuple[AccessPoint, ...]
    shadowing: RandomField

    def mean_dbm(self, floor: Floor, xy: Floats, heading_rad: Floats | None = None) -> Floats:
        """Return the mean received power.

        Args:
            floor: where the receiver is.
            xy: (n, 2) places where all access points are heard, or (n, T, 2), one place for each, metres.
            heading_rad: (n,) or (n, T), where the person looks; None leaves the body out.

        Returns:
            (n, T) float64, dBm.
        """
        s = self.settings
        aps = self.access_points
        n = len(xy)
        places = np.broadcast_to(xy[:, None, :] if xy.ndim == 2 else xy, (n, len(aps), 2))
        ap_xy = np.array([ap.xy for ap in aps], dtype=np.float64).reshape(-1, 2)
        ap_z = np.array([self._base_m(self._floor(ap.floor)) + ap.height_m for ap in aps])
        z = self._base_m(floor) + RECEIVER_HEIGHT_M
        offset = ap_xy - places
        # Log-distance holds from the reference distance on, 1 m; nearer, a ceiling point would grow without limit.
        distance = np.maximum(1.0, np.sqrt((offset**2).sum(axis=-1) + (ap_z - z) ** 2))
        dbm: Floats = np.array([ap.power_dbm for ap in aps]) - 10.0 * s.exponent * np.log10(distance)
        dbm -= s.wall_db * self._walls_between(floor, places, ap_xy)
        between = np.array([abs(self._floor(ap.floor).level - floor.level) for ap in aps], dtype=np.float64)
        dbm -= np.where(between > 0, s.floor_db * between ** ((between + 2) / (between + 1) - 0.46), 0.0)
        dbm += self.shadowing.each_at(np.concatenate([places, np.full((n, len(aps), 1), z)], axis=-1))
        if heading_rad is not None:
            heading = np.broadcast_to(heading_rad[:, None] if heading_rad.ndim == 1 else heading_rad, (n, len(aps)))
            facing = np.cos(np.arctan2(offset[..., 0], offset[..., 1]) - heading)
            dbm -= s.body_db * (1.0 - facing) / 2.0
        return dbm

    def _walls_between(self, floor: Floor, places: Floats, ap_xy: Floats) -> Floats:
        """Count walls; of the way to another floor, one half runs on this floor and the other on that."""
        count = np.zeros(places.shape[:2])
        for other in {ap.floor: None for ap in self.access_points}:
            here = [i for i, ap in enumerate(self.access_points) if ap.floor == other]
            a = places[:, here].reshape(-1, 2)
            b = np.broadcast_to(ap_xy[here], (len(places), len(here), 2)).reshape(-1, 2)
            middle = b if other == floor.name else (a + b) / 2.0
            walls = count_wall_crossings(a, middle, barriers(floor))
            if other != floor.name:
                walls = walls + count_wall_crossings(middle, b, barriers(self._floor(other)))
            count[:, here] = walls.reshape(len(places), len(here))
        return count

    def _floor(self, name: str) -> Floor:
        return next(floor for floor in self.floors if floor.name == name)

    def _base_m(self, floor: Floor) -> float:
        return floor.level * self.settings.floor_height_m


def draw_radio(
    settings: Propagation, floors: tuple[Floor, ...], access_points: tuple[AccessPoint, ...], rng: Rng
) -> Radio:
    """Draw the shadowing of a building."""
    known = {floor.name for floor in floors}
    for ap in access_points:
        if ap.floor not in known:
            raise ValueError(f"access point {ap.name}: found floor {ap.floor!r}, expected one of {sorted(known)}")
    shadowing = draw_field(
        rng, functions=len(access_points), sigma=settings.shadowing_db, length_m=settings.shadowing_m
    )
    return Radio(settings, floors, access_points, shadowing)


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
        delivery_s: shortest and longest time from the last reading to its delivery to the app.
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
class SimulatedScan:
    """What one scan reports.

    Attributes:
        begin_s, end_s: when the phone began and ended to listen.
        delivered_s: when the scan was delivered.
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


def simulate_scans(
    trajectory: Trajectory, floor: Floor, radio: Radio, receiver: Receiver, rng: Rng
) -> tuple[SimulatedScan, ...]:
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
    begin, end, delivered = _scan_times(float(trajectory.t_s[-1]), receiver, time_rng)
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
            SimulatedScan(
                begin_s=float(begin[k]),
                end_s=float(end[k]),
                delivered_s=float(delivered[k]),
                access_point=aps,
                rssi_dbm=dbm[row, aps],
                heard_s=at[row, aps],
            )
        )
    return tuple(reports)


def _scan_times(duration_s: float, receiver: Receiver, rng: Rng) -> tuple[Floats, Floats, Floats]:
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
