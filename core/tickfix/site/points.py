"""Reference points of a radio map from a survey on foot: a pure function, so that better rules can take its place.

A scan is spread over seconds, and its readings are delivered again and again by later scans. So readings are not taken
as the scans brought them: each counts once, at the place where it was heard, and belongs to the scan nearest in time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tickfix.api import Floats, Ints


class Points(NamedTuple):
    """Reference points and who belongs to them.

    Attributes:
        xy: (p, 2) float64, metres.
        of_reading: (n,) int64, the point of each reading; −1 where it was heard too long before or after any scan.
    """

    xy: Floats
    of_reading: Ints


def reference_points(
    heard_ns: Ints, xy: Floats, scan_t_ns: Ints, *, point_window_s: float = 2.5, merge_m: float = 0.1
) -> Points:
    """Make one reference point per scan, at the mean place of the readings heard around it.

    Scans that follow each other within ``merge_m`` of the point they began share that point: this is how several scans
    at one spot, a static survey, become the spot itself.

    Args:
        heard_ns: (n,) int64, when each reading of one walk on one floor was heard.
        xy: (n, 2) float64, metres: where.
        scan_t_ns: (m,) int64, times of the scans, increasing.
        point_window_s: greatest distance in time between a reading and its scan, seconds.
        merge_m: greatest distance between two scans at one spot, metres.
    """
    none = np.full(len(heard_ns), -1, dtype=np.int64)
    if len(scan_t_ns) == 0 or len(heard_ns) == 0:
        return Points(np.zeros((0, 2)), none)
    after = np.clip(np.searchsorted(scan_t_ns, heard_ns), 1, max(len(scan_t_ns) - 1, 1))
    after = np.minimum(after, len(scan_t_ns) - 1)
    before = np.maximum(after - 1, 0)
    to_before, to_after = np.abs(heard_ns - scan_t_ns[before]), np.abs(heard_ns - scan_t_ns[after])
    scan = np.where(to_before <= to_after, before, after)
    near = np.minimum(to_before, to_after) <= round(point_window_s * 1e9)

    of_scan = np.full(len(scan_t_ns), -1, dtype=np.int64)
    spots: list[Floats] = []
    for i in np.unique(scan[near]):
        spot = xy[near & (scan == i)].mean(axis=0)
        if not spots or np.hypot(*(spot - spots[-1])) > merge_m:
            spots.append(spot)
        of_scan[i] = len(spots) - 1
    of_reading = np.where(near, of_scan[scan], none)
    places = [xy[of_reading == k].mean(axis=0) for k in range(len(spots))]
    return Points(np.array(places).reshape(-1, 2), of_reading)
