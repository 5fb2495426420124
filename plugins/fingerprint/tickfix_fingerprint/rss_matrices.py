"""Survey samples of reference points as the matrices **RSS**_l that [sun2013] eq. (1) correlates with.

[sun2013] compares N on-line samples of M access points with "created" matrices of the same shape and does not print how
they are created. Here they are blocks of N survey samples of a point, so that they keep its variation.

A survey records when each *reading* was heard. On a walk the readings of one scan are seconds apart, and a point is
described by parts of several scans. A sample of a point is therefore put together from the readings of one chain of
walks within ``sample_s``, the n-th reading of each transmitter there going to the n-th sample. Samples follow each
other by chain and time; every N of them are a block, without overlap, and the last of a point may be short. A
transmitter that a block heard only in some of its samples has their mean in the others, one that it never heard is
missing in all. A block that is short of samples is filled in the same way, and so are the on-line scans.

Values are dBm above ``missing_dbm``: what is missing is zero, and matrices are sparse. A correlation coefficient does
not change when all its values are shifted by a constant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, Final

import numpy as np
import scipy.sparse

from tickfix.api import Bools, Floats, Ints, RadioMap, Readings, frozen

_SECOND_NS: Final = 10**9


class RssBlocks:
    """The blocks of all points of a radio map.

    Attributes:
        point: (B,) int64, which point a block describes, an index into ``xy`` and ``floor``; ascending.
        starts: (P,) int64, the first block of each point.
        by_cell: sparse (N·M, B): column *b* is **RSS** of block *b*, row j·M + i its sample j of transmitter i.
        sums, squares: (B,) float64, Σ_j Σ_i RSS_{i,j} and Σ_j Σ_i RSS²_{i,j}.
        xy, floor: (P, 2) float64, metres, and (P,) int64, of the points that have samples.
        shape: (M, N).
    """

    def __init__(
        self,
        radio_map: RadioMap,
        n: int,
        *,
        means: bool,
        missing_dbm: float,
        sample_s: float,
        sample_mask: Bools | None = None,
        sources: Sequence[str] = ("wifi",),
    ) -> None:
        """Make blocks of ``n`` samples of each point, or one of its mean repeated ``n`` times if ``means``.

        Args:
            radio_map: the survey.
            n: N.
            means: one block a point, each column the mean over all of its samples that heard the transmitter.
            missing_dbm: stands for what is not heard.
            sample_s: readings of a point within so many seconds can belong to one sample.
            sample_mask: (S,) bool, the survey samples to use; all by default.
            sources: whose transmitters to use.
        """
        m = len(radio_map.transmitters)
        asked = radio_map.of_sources(sources)
        point, sample = radio_map.described()
        kept = asked[radio_map.sample_transmitter[sample]] & (radio_map.sample_rssi_dbm[sample] > missing_dbm)
        if sample_mask is not None:
            kept &= sample_mask[sample]
        point, sample = point[kept], sample[kept]
        known, inverse = np.unique(point, return_inverse=True)
        point = inverse.astype(np.int64)
        transmitter = radio_map.sample_transmitter[sample]
        if means:
            block, slot = point, np.zeros(len(point), np.int64)
        else:
            number = _sample_numbers(radio_map, point, sample, sample_s)
            # Blocks are numbered on from point to point.
            count = np.zeros(len(known), np.int64)
            np.maximum.at(count, point, number // n + 1)
            block, slot = (np.cumsum(count) - count)[point] + number // n, number % n
        above_dbm = radio_map.sample_rssi_dbm[sample] - missing_dbm
        row, cell_block, value = _fill_blocks(block, slot, transmitter, above_dbm, n, m)
        blocks = int(block.max()) + 1 if len(block) else 0
        self.shape = (m, n)
        self.xy = frozen(radio_map.point_xy[known])
        self.floor = frozen(radio_map.point_floor[known], np.int64)
        self.by_cell: Any = scipy.sparse.csr_matrix((value, (row, cell_block)), shape=(n * m, blocks))
        self.sums = frozen(np.bincount(cell_block, weights=value, minlength=blocks))
        self.squares = frozen(np.bincount(cell_block, weights=value**2, minlength=blocks))
        self.point = np.zeros(blocks, np.int64)
        self.point[block] = point
        self.starts = frozen(np.searchsorted(self.point, np.arange(len(known))), np.int64)

    def dense(self, block: int) -> Floats:
        """Return **RSS** of one block: (M, N) float64."""
        m, n = self.shape
        column, part = np.zeros(n * m), slice(*self._by_block.indptr[block : block + 2])
        column[self._by_block.indices[part]] = self._by_block.data[part]
        return column.reshape(n, m).T

    @cached_property
    def _by_block(self) -> Any:
        return self.by_cell.tocsc()


def online_matrix(
    window: Readings, numbers: Mapping[str, int], shape: tuple[int, int], missing_dbm: float
) -> tuple[Ints, Floats, int]:
    """Return **rss** of the last ``n`` scans of a window, filled like a block.

    Args:
        window: readings; those of unknown transmitters are left out.
        numbers: the number, below M, of each known transmitter of the window's source.
        shape: (M, N).
        missing_dbm: stands for what is not heard.

    Returns:
        cells (c,) int64, values (c,) float64 (value of sample j of transmitter i at cell j·M + i, all others zero), and
        the number of transmitters heard.
    """
    m, n = shape
    first = len(window.scan_t_ns) - n
    newest: dict[tuple[int, int], float] = {}
    rows = zip(window.transmitters, window.rssi_dbm.tolist(), window.scan.tolist(), strict=True)
    for transmitter, rssi_dbm, scan in rows:
        i = numbers.get(transmitter)
        if i is not None and scan >= first and rssi_dbm > missing_dbm:
            newest[i, max(scan - first, 0)] = rssi_dbm - missing_dbm  # readings come oldest first
    keys = np.array(list(newest), np.int64).reshape(-1, 2)
    values = np.array(list(newest.values()), np.float64)
    cells, _, filled = _fill_blocks(np.zeros(len(keys), np.int64), keys[:, 1], keys[:, 0], values, n, m)
    return cells, filled, len(np.unique(keys[:, 0]))


def _sample_numbers(radio_map: RadioMap, point: Ints, sample: Ints, sample_s: float) -> Ints:
    """Return for each pair (point, reading) the number of the point's sample that the reading belongs to."""
    chain, t_ns = radio_map.sample_chain[sample], radio_map.sample_t_ns[sample]
    span = t_ns // round(sample_s * _SECOND_NS)
    transmitter = radio_map.sample_transmitter[sample]
    order = np.lexsort((t_ns, transmitter, span, chain, point))
    first = _first_of_group(point[order], chain[order], span[order], transmitter[order])
    places = np.arange(len(order))
    nth = np.empty(len(order), np.int64)
    nth[order] = places - np.maximum.accumulate(np.where(first, places, 0))
    order = np.lexsort((nth, span, chain, point))
    numbers = np.empty(len(order), np.int64)
    numbers[order] = np.cumsum(_first_of_group(point[order], chain[order], span[order], nth[order])) - 1
    start = np.full(int(point.max(initial=-1)) + 1, len(order))
    np.minimum.at(start, point, numbers)
    within: Ints = numbers - start[point]
    return within


def _first_of_group(*keys: Ints) -> Bools:
    """Return for each row of sorted keys whether it is the first of its kind: (n,) bool."""
    changes: Bools = np.zeros(len(keys[0]), np.bool_)
    changes[:1] = True
    for key in keys:
        changes[1:] |= np.diff(key) != 0
    return changes


def _fill_blocks(
    block: Ints, slot: Ints, transmitter: Ints, value: Floats, n: int, m: int
) -> tuple[Ints, Ints, Floats]:
    """Return cell (j·M + i), block and value of every cell of the blocks that is not zero.

    Readings in one cell are averaged; then those cells are filled whose transmitter the block heard in others only.
    """
    cells, cell = np.unique((block * m + transmitter) * n + slot, return_inverse=True)
    means = np.bincount(cell, weights=value) / np.bincount(cell)
    pairs, pair = np.unique(cells // n, return_inverse=True)
    matrix = np.repeat((np.bincount(pair, weights=means) / np.bincount(pair))[:, None], n, axis=1)
    matrix[pair, cells % n] = means
    rows: Ints = np.arange(n) * m + (pairs % max(m, 1))[:, None]
    return rows.ravel(), np.repeat(pairs // max(m, 1), n), matrix.ravel()
