"""Fingerprints as a table (places × transmitters): from arrays, data frames or CSV files to a radio map."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from tickfix.api import Floats, Ints, RadioMap, SiteError, frozen

_FLOOR: Final = "F1"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class FingerprintTable:
    """n fingerprints: what was received at a known place.

    Attributes:
        rssi_dbm: (n, t) float64, NaN where a transmitter was not heard.
        xy: (n, 2) float64, metres, floor frame.
        floors: n names of floors.
        transmitters: t ids, those of the columns.
        groups: (n,) int64: rows that were recorded together share a number, so that a fair split keeps them together.
    """

    rssi_dbm: Floats
    xy: Floats
    floors: tuple[str, ...]
    transmitters: tuple[str, ...]
    groups: Ints

    def __post_init__(self) -> None:
        """Freeze the arrays.

        Raises:
            SiteError: when shapes do not fit, a place or a reading is not finite, or an id stands twice.
        """
        for name, dtype in (("rssi_dbm", np.float64), ("xy", np.float64), ("groups", np.int64)):
            object.__setattr__(self, name, frozen(getattr(self, name), dtype))
        n, t = len(self.xy), len(self.transmitters)
        shapes = {"rssi_dbm": (n, t), "xy": (n, 2), "groups": (n,)}
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise SiteError(f"fingerprints: {name} has shape {getattr(self, name).shape}, expected {shape}")
        if len(self.floors) != n:
            raise SiteError(f"fingerprints: found {len(self.floors)} floors, expected {n}, one for each row")
        if bad := np.flatnonzero(~np.isfinite(self.xy).all(axis=1)).tolist():
            raise SiteError(f"fingerprints: row {bad[0]} has the place {self.xy[bad[0]].tolist()}, expected metres")
        if np.isinf(self.rssi_dbm).any():
            raise SiteError("fingerprints: found an infinite reading, expected dBm, or NaN where nothing was heard")
        if len(set(self.transmitters)) != t:
            twice = next(name for name in self.transmitters if self.transmitters.count(name) > 1)
            raise SiteError(f"fingerprints: transmitter {twice!r} has several columns, expected one")

    @staticmethod
    def of(
        rssi_dbm: ArrayLike,
        xy: ArrayLike,
        *,
        floors: Sequence[str] | str = _FLOOR,
        transmitters: Sequence[str] | None = None,
        groups: ArrayLike | None = None,
        not_heard: float | None = None,
    ) -> FingerprintTable:
        """Return the table of arrays.

        Args:
            rssi_dbm: (n, t), dBm.
            xy: (n, 2), metres.
            floors: n names, or one for all.
            transmitters: t ids; ``tx0``, ``tx1`` … without them.
            groups: (n,) integers; each row is a group of its own without them.
            not_heard: value in ``rssi_dbm`` that stands for a transmitter not heard, besides NaN.
        """
        rssi = np.array(rssi_dbm, dtype=np.float64)
        if rssi.ndim != 2:
            raise SiteError(f"fingerprints: rssi_dbm has shape {rssi.shape}, expected (n, t)")
        if not_heard is not None:
            rssi[rssi == not_heard] = np.nan
        n = len(rssi)
        return FingerprintTable(
            rssi_dbm=rssi,
            xy=np.asarray(xy, dtype=np.float64),
            floors=(floors,) * n if isinstance(floors, str) else tuple(map(str, floors)),
            transmitters=tuple(f"tx{i}" for i in range(rssi.shape[1])) if transmitters is None else tuple(transmitters),
            groups=np.arange(n) if groups is None else np.asarray(groups, dtype=np.int64),
        )

    @staticmethod
    def from_frame(
        frame: Any,
        *,
        x: str = "x_m",
        y: str = "y_m",
        floor: str = "floor",
        group: str = "group",
        ignore: Iterable[str] = (),
        not_heard: float | None = None,
    ) -> FingerprintTable:
        """Return the table of a data frame: one row a fingerprint, one column a transmitter.

        Args:
            frame: a pandas ``DataFrame``, or a mapping from column names to arrays (n,).
            x, y: columns of the place, metres.
            floor: column of the floor's name; where there is none, all is on one floor ``F1``.
            group: column that is equal for rows recorded together; may be absent.
            ignore: columns that are neither of these nor a transmitter.
            not_heard: value that stands for a transmitter not heard, besides NaN.

        Raises:
            SiteError: when a column is missing or holds no numbers.
        """
        columns: dict[str, Any] = {str(name): np.asarray(frame[name]) for name in frame}
        for name in (x, y):
            if name not in columns:
                found = ", ".join(list(columns)[:8])
                raise SiteError(f"fingerprints: no column {name!r} among {found} …; name the columns by x= and y=")
        special = {x, y, floor, group, *ignore}
        transmitters = [name for name in columns if name not in special]
        n = len(columns[x])
        groups = np.unique(columns[group], return_inverse=True)[1] if group in columns else np.arange(n)
        rssi = [_numbers(name, columns[name]) for name in transmitters]
        return FingerprintTable.of(
            np.column_stack(rssi) if rssi else np.zeros((n, 0)),
            np.column_stack([_numbers(x, columns[x]), _numbers(y, columns[y])]),
            floors=tuple(map(str, columns[floor])) if floor in columns else _FLOOR,
            transmitters=transmitters,
            groups=groups.reshape(n),
            not_heard=not_heard,
        )

    @staticmethod
    def read_csv(
        path: str | PathLike[str],
        *,
        x: str = "x_m",
        y: str = "y_m",
        floor: str = "floor",
        group: str = "group",
        ignore: Iterable[str] = (),
        not_heard: float | None = None,
    ) -> FingerprintTable:
        """Return the table of a CSV file with a header; the columns are those of :meth:`from_frame`.

        An empty cell is a transmitter that was not heard. For instance::

            floor,x_m,y_m,aa:01,aa:02
            F1,2.0,3.5,-61,-77
            F1,4.0,3.5,,-70

        Raises:
            SiteError: when the file cannot be read, a row has too few or too many cells, or a cell holds no number.
        """
        file = Path(path)
        try:
            with file.open(encoding="utf-8-sig", newline="") as lines:
                rows = list(csv.reader(lines))
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise SiteError(f"{file}: cannot be read: {error}") from error
        if len(rows) < 2:
            raise SiteError(f"{file}: found {len(rows)} lines, expected a header and fingerprints")
        header = rows[0]
        for number, row in enumerate(rows[1:], start=2):
            if row and len(row) != len(header):
                raise SiteError(f"{file}: line {number} has {len(row)} cells, expected {len(header)}")
        cells = [row for row in rows[1:] if row]
        columns: Mapping[str, Any] = {name: np.array([row[i] for row in cells]) for i, name in enumerate(header)}
        if len(columns) != len(header):
            raise SiteError(f"{file}: a column stands twice in the header")
        try:
            return FingerprintTable.from_frame(
                columns, x=x, y=y, floor=floor, group=group, ignore=ignore, not_heard=not_heard
            )
        except SiteError as error:
            raise SiteError(f"{file}: {error}") from error

    def __len__(self) -> int:
        """Return n."""
        return len(self.xy)

    def __repr__(self) -> str:
        """Return one line: how many fingerprints of how many transmitters on which floors."""
        floors = ", ".join(sorted(set(self.floors)))
        return f"<FingerprintTable: {len(self)} fingerprints of {len(self.transmitters)} transmitters on {floors}>"

    def radio_map(self) -> RadioMap:
        """Return the radio map: rows at one place of one floor are the samples of one reference point.

        Raises:
            SiteError: when nothing was heard at all.
        """
        floors, floor = np.unique(np.array(self.floors, dtype=np.str_), return_inverse=True)
        order = np.argsort(np.array(self.transmitters, dtype=np.str_), kind="stable")
        places, point = np.unique(np.column_stack([floor, self.xy]), axis=0, return_inverse=True)
        row, transmitter = np.nonzero(np.isfinite(self.rssi_dbm[:, order]))
        if not len(row):
            raise SiteError(f"fingerprints: no reading in {len(self)} rows, expected dBm in the transmitters' columns")
        return RadioMap(
            floors=tuple(map(str, floors)),
            transmitters=tuple(self.transmitters[i] for i in order),
            point_floor=places[:, 0].astype(np.int64),
            point_xy=places[:, 1:],
            sample_point=point.reshape(-1)[row].astype(np.int64),
            sample_transmitter=transmitter.astype(np.int64),
            sample_rssi_dbm=self.rssi_dbm[:, order][row, transmitter],
            sample_xy=self.xy[row],
            sample_t_ns=np.zeros(len(row), dtype=np.int64),
            sample_chain=self.groups[row],
        )


def _numbers(name: str, column: Any) -> Floats:
    """Return a column (n,) as float64, NaN where a cell is empty."""
    if column.dtype.kind in "US":
        column = np.where(np.char.strip(column) == "", "nan", column)
    try:
        return np.asarray(column, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SiteError(f"fingerprints: column {name!r} holds no numbers ({error}); leave it out by ignore=") from error
