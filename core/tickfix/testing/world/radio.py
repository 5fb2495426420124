"""The radio world: twelve transmitters on each floor that fall off with distance, heard from floor to floor."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np

from tickfix.api import Floats, RadioMap, Readings, Scan, frozen
from tickfix.testing.world.chance import rng
from tickfix.testing.world.plan import HEIGHT_M, WIDTH_M, floors
from tickfix.testing.world.walks import T0_NS


@cache
def radio_map() -> RadioMap:
    """Return the survey: a grid of points 2 m apart on each floor, three samples of each transmitter at each."""
    names = sorted({name for floor in floors() for name in _transmitters(floor)})
    index = {name: n for n, name in enumerate(names)}
    floor_of, xy, rows = [], [], []
    noise = rng(1)
    for f, floor in enumerate(floors()):
        for x in np.arange(1.0, WIDTH_M, 2.0):
            for y in np.arange(1.0, HEIGHT_M, 2.0):
                floor_of.append(f)
                xy.append((x, y))
                for name, rssi_dbm in heard_at(floor, np.array([x, y])).items():
                    rows += [(len(xy) - 1, index[name], rssi_dbm + noise.normal(0.0, 1.0)) for _ in range(3)]
    point = np.array([row[0] for row in rows], np.int64)
    return RadioMap(
        floors=tuple(floors()),
        transmitters=tuple(names),
        point_floor=np.array(floor_of, np.int64),
        point_xy=np.array(xy),
        sample_point=point,
        sample_transmitter=np.array([row[1] for row in rows], np.int64),
        sample_rssi_dbm=np.array([row[2] for row in rows]),
        sample_xy=np.array(xy)[point],
        sample_t_ns=T0_NS + np.arange(len(rows), dtype=np.int64),
        sample_chain=point % 7,
    )


def heard_at(floor: str, xy: Floats) -> Mapping[str, float]:
    """Return what is heard at a place without any noise, dBm by transmitter; nothing below −95 dBm."""
    heard = {}
    for other in floors():
        storeys = abs(floors()[other].level - floors()[floor].level)
        for name, at in _transmitters(other).items():
            distance_m = math.hypot(xy[0] - at[0], xy[1] - at[1], 3.0 * storeys + 1.0)
            rssi_dbm = -40.0 - 30.0 * math.log10(distance_m) - 15.0 * storeys
            if rssi_dbm >= -95.0:
                heard[name] = rssi_dbm
    return heard


def readings(
    floor: str = "F1", xy: Sequence[float] = (3.0, 3.0), *, t_ns: int = T0_NS, noise_db: float = 0.0
) -> Readings:
    """Return the window of one scan at a place."""
    return Readings.of(scan(floor, xy, t_ns=t_ns, noise_db=noise_db))


def scan(floor: str = "F1", xy: Sequence[float] = (3.0, 3.0), *, t_ns: int = T0_NS, noise_db: float = 0.0) -> Scan:
    """Return a scan at a place."""
    heard = heard_at(floor, np.asarray(xy, dtype=np.float64))
    rssi_dbm = np.array(list(heard.values())) + noise_db * rng(2, t_ns % 2**31).standard_normal(len(heard))
    return Scan(transmitters=tuple(heard), rssi_dbm=rssi_dbm, heard_ns=np.full(len(heard), t_ns, np.int64))


def window_of(t_ns: int, transmitters: Sequence[str], rssi_dbm: Sequence[float], ages_s: Sequence[float]) -> Readings:
    """Return a window of readings, oldest first."""
    order = np.argsort(-np.asarray(ages_s, np.float64), kind="stable").tolist()
    return Readings(
        t_ns=t_ns,
        transmitters=tuple(transmitters[n] for n in order),
        rssi_dbm=frozen([rssi_dbm[n] for n in order]),
        heard_ns=frozen([t_ns - round(ages_s[n] * 1e9) for n in order], np.int64),
        scan=frozen(np.zeros(len(order)), np.int64),
        scan_t_ns=(t_ns,),
    )


def _transmitters(floor: str) -> Mapping[str, Floats]:
    level = floors()[floor].level
    places = [(x, y) for x in (1.0, 7.0, 13.0, 19.0) for y in (1.0, 6.0, 11.0)]
    return {f"02:00:00:00:{level:02x}:{n:02x}": np.array(xy) for n, xy in enumerate(places)}
