"""One sensor's samples within one tick: one row per instant, whatever the order and the batches they came in."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from operator import lt
from typing import Final

import numpy as np

from tickfix.api.arrays import Floats, Ints
from tickfix.api.events import TICK_NS, Samples
from tickfix.kernel.measurements import Row, rows_of

_MOST: Final = 512
"""Samples of a sensor within a tick: 2560 Hz."""


def tick_of(t_ns: int) -> int:
    """Return the tick that closes the interval holding ``t_ns``: the smallest k with k·200 ms ≥ t."""
    return -(-t_ns // TICK_NS)


def is_increasing(times: list[int]) -> bool:
    """Tell whether every time is later than the one before."""
    return all(map(lt, times, times[1:]))


def by_tick(times: list[int]) -> Iterator[tuple[int, int, int]]:
    """Yield the ticks of increasing times, and where the times of each begin and end."""
    begin = 0
    while begin < len(times):
        tick = tick_of(times[begin])
        end = bisect_right(times, tick * TICK_NS, begin)
        yield tick, begin, end
        begin = end


def _known_to_fit(t_ns: Ints, values: Floats) -> Samples:
    """Return samples without checking again what was checked when they came."""
    samples = object.__new__(Samples)
    object.__setattr__(samples, "t_ns", t_ns)
    object.__setattr__(samples, "values", values)
    return samples


class TickSamples:
    """Samples of one sensor, (n,) instants and (n, c) rows; of two rows at an instant the smaller one stands.

    Of more instants than any sensor has in 200 ms the first 512 stand, in whatever order they come.

    What comes in order is kept in the arrays that brought it. What does not turns them into a mapping, which takes
    anything and is put in order when it is read.

    Attributes:
        crowded: samples left out, since this was last taken.
    """

    __slots__ = ("_last_ns", "_loose", "_n", "_pieces", "crowded")

    def __init__(self) -> None:
        """Begin empty."""
        self._pieces: list[tuple[Ints, Floats]] = []
        self._last_ns = -1
        self._n = 0
        self._loose: dict[int, Row] | None = None
        self.crowded = 0

    def extend(self, t_ns: Ints, rows: Floats) -> tuple[int, bool]:
        """Take samples in, in increasing time; return how many instants are new, and whether anything changed.

        Args:
            t_ns: (n,), none negative; kept.
            rows: (n, c), finite, without negative zeros; kept.
        """
        if self._loose is None and t_ns.item(0) > self._last_ns:
            room = max(0, _MOST - self._n)
            self.crowded += max(0, len(t_ns) - room)
            if room:
                self._pieces.append((t_ns[:room], rows[:room]))
                self._n += len(self._pieces[-1][0])
            self._last_ns = t_ns.item(-1)
            return len(t_ns), room > 0
        found = [self.put(t, row) for t, row in zip(t_ns.tolist(), rows_of(rows), strict=True)]
        return sum(new for new, _ in found), any(changed for _, changed in found)

    def put(self, t_ns: int, row: Row) -> tuple[bool, bool]:
        """Take one sample in; return whether its instant is new, and whether anything changed."""
        if self._loose is None:
            self._loose = self._mapped()
            self._pieces.clear()
        present = self._loose.get(t_ns)
        changed = present is None or row < present
        if changed:
            self._loose[t_ns] = row
        if len(self._loose) > 2 * _MOST:  # seldom, so that one more sample costs little
            self.crowded += len(self._loose) - _MOST
            self._loose = dict(sorted(self._loose.items())[:_MOST])
        return present is None, changed

    def take_crowded(self) -> int:
        """Return how many samples were left out since this was last asked."""
        crowded, self.crowded = self.crowded, 0
        return crowded

    def ordered(self) -> Samples:
        """Return what is there, in increasing time."""
        if self._loose is not None:
            ordered = sorted(self._loose.items())[:_MOST]
            return Samples(np.array([t for t, _ in ordered], np.int64), np.array([row for _, row in ordered]))
        if len(self._pieces) > 1:
            # One piece from now on, for whoever asks next.
            t_ns = np.concatenate([times for times, _ in self._pieces])
            self._pieces = [(t_ns, np.concatenate([rows for _, rows in self._pieces]))]
        t_ns, values = self._pieces[0]
        t_ns.setflags(write=False)  # nobody else has them: not copied again
        values.setflags(write=False)
        return _known_to_fit(t_ns, values)

    def _mapped(self) -> dict[int, Row]:
        return {t: row for t_ns, rows in self._pieces for t, row in zip(t_ns.tolist(), rows_of(rows), strict=True)}
