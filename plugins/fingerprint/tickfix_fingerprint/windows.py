"""Windows of several scans, put together from a surveyed walk as the kernel would on-line."""

from __future__ import annotations

import numpy as np

from tickfix.api import Readings, SurveyWalk, frozen


def last_scans(walk: SurveyWalk, number: int, scans: int, max_age_s: float) -> Readings:
    """Return the window of the last ``scans`` scans that ends with the walk's ``number``-th.

    Each reading stands at its first delivery; those older than ``max_age_s`` are left out.
    """
    last = walk.scans[number]
    oldest_ns = last.t_ns - round(max_age_s * 1e9)
    chosen = [s for s in walk.scans[: number + 1] if s.source == last.source and s.t_ns >= oldest_ns][-scans:]
    seen: set[tuple[str, int]] = set()
    rows: list[tuple[int, int, str, float]] = []
    for place, scan in enumerate(chosen):
        for transmitter, rssi_dbm, heard_ns in zip(
            scan.transmitters, scan.rssi_dbm.tolist(), scan.heard_ns.tolist(), strict=True
        ):
            if heard_ns >= oldest_ns and (transmitter, heard_ns) not in seen:
                seen.add((transmitter, heard_ns))
                rows.append((place, heard_ns, transmitter, rssi_dbm))
    rows.sort()
    return Readings(
        t_ns=last.t_ns,
        transmitters=tuple(row[2] for row in rows),
        rssi_dbm=frozen([row[3] for row in rows]),
        heard_ns=frozen([row[1] for row in rows], np.int64),
        scan=frozen([row[0] for row in rows], np.int64),
        scan_t_ns=tuple(scan.t_ns for scan in chosen),
        source=last.source,
    )
