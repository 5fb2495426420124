"""What a receiver would measure, averaged over time, at any place of a building."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tickfix.api import Floats, Floor, Rng
from tickfix.simulation.crossings import barriers, count_crossings
from tickfix.simulation.fields import RandomField, draw_field

RECEIVER_M: Final = 1.2
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
        z = self._base_m(floor) + RECEIVER_M
        way = ap_xy - places
        # Log-distance holds from the reference distance on, 1 m; nearer, a ceiling point would grow without limit.
        distance = np.maximum(1.0, np.sqrt((way**2).sum(axis=-1) + (ap_z - z) ** 2))
        dbm: Floats = np.array([ap.power_dbm for ap in aps]) - 10.0 * s.exponent * np.log10(distance)
        dbm -= s.wall_db * self._walls_between(floor, places, ap_xy)
        between = np.array([abs(self._floor(ap.floor).level - floor.level) for ap in aps], dtype=np.float64)
        dbm -= np.where(between > 0, s.floor_db * between ** ((between + 2) / (between + 1) - 0.46), 0.0)
        dbm += self.shadowing.each_at(np.concatenate([places, np.full((n, len(aps), 1), z)], axis=-1))
        if heading_rad is not None:
            heading = np.broadcast_to(heading_rad[:, None] if heading_rad.ndim == 1 else heading_rad, (n, len(aps)))
            facing = np.cos(np.arctan2(way[..., 0], way[..., 1]) - heading)
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
            walls = count_crossings(a, middle, barriers(floor))
            if other != floor.name:
                walls = walls + count_crossings(middle, b, barriers(self._floor(other)))
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
