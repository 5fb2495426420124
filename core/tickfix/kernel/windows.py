"""Windows of readings: what a fingerprint gets to see of the scans of a device."""

from __future__ import annotations

from bisect import bisect_right, insort
from typing import Final

import numpy as np

from tickfix.api.events import Scan
from tickfix.api.values import Readings, Window
from tickfix.kernel.measurements import scan_order

WINDOW_NS: Final = 60_000_000_000
"""The longest window of readings: scans are kept for so long, whatever is refolded."""


class RecentScans:
    """The scans of the last minute, in their order."""

    def __init__(self, scans: tuple[Scan, ...] = ()) -> None:
        """Begin with those that are known, in their order."""
        self._scans = list(scans)

    def add(self, scan: Scan) -> None:
        """Take a scan in; it must not be there yet."""
        insort(self._scans, scan, key=scan_order)

    def leave_out(self, scan: Scan) -> None:
        """Take a scan out again; it must be there."""
        del self._scans[bisect_right(self._scans, scan_order(scan), key=scan_order) - 1]

    def with_(self, scan: Scan) -> RecentScans:
        """Return the same scans and one more, if it is not there yet."""
        if any(scan_order(present) == scan_order(scan) for present in self._scans if present.t_ns == scan.t_ns):
            return RecentScans(self.kept)
        more = RecentScans(self.kept)
        more.add(scan)
        return more

    def forget_before(self, t_ns: int) -> None:
        """Drop what no window that ends at ``t_ns`` or later holds."""
        while self._scans and self._scans[0].t_ns < t_ns - WINDOW_NS:
            del self._scans[0]

    def window(self, scan: Scan, window: Window) -> Readings:
        """Return the readings that ``window`` asks for, ending with ``scan``: each once, none over a minute old.

        The scan itself need not have been added.
        """
        oldest_ns = scan.t_ns - round(min(window.seconds * 1e9, WINDOW_NS))
        order = scan_order(scan)
        end = bisect_right(self._scans, order, key=scan_order)
        if end and scan_order(self._scans[end - 1]) == order:
            end -= 1
        scans = [scan][: window.scans]
        for candidate in reversed(self._scans[:end]):
            if candidate.t_ns < oldest_ns or len(scans) == window.scans:
                break
            if candidate.source == scan.source:
                scans.append(candidate)
        return _readings(scan, scans[::-1], oldest_ns)

    @property
    def kept(self) -> tuple[Scan, ...]:
        """All of them."""
        return tuple(self._scans)


def _readings(newest: Scan, scans: list[Scan], oldest_ns: int) -> Readings:
    found: dict[tuple[str, int], tuple[int, float]] = {}
    for number, scan in enumerate(scans):
        heard = zip(scan.transmitters, scan.heard_ns.tolist(), scan.rssi_dbm.tolist(), strict=True)
        for transmitter, heard_ns, rssi_dbm in heard:
            if heard_ns >= oldest_ns:
                found.setdefault((transmitter, heard_ns), (number, rssi_dbm))
    rows = sorted((number, heard_ns, name, rssi) for (name, heard_ns), (number, rssi) in found.items())
    return Readings(
        t_ns=newest.t_ns,
        transmitters=tuple(row[2] for row in rows),
        rssi_dbm=np.array([row[3] for row in rows], np.float64),
        heard_ns=np.array([row[1] for row in rows], np.int64),
        scan=np.array([row[0] for row in rows], np.int64),
        scan_t_ns=tuple(scan.t_ns for scan in scans),
        source=newest.source,
    )
