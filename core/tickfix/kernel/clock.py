"""A device's clock as its samples show it: which times to follow, which to doubt, and when it has restarted.

Phones' clocks start anywhere, drift, step and reboot, and single samples carry times that are plainly wrong. Every
sample is judged by itself, so that batching cannot matter:

- it *follows* when it lies within the horizon behind, or within reach ahead of, what was seen so far. While motion
  sensors are heard, the reach is ``jump_ns``: they do not pause. A phone that only scans pauses for up to a minute;
- it is *held* when it jumps further ahead, or when its own stream runs backwards beyond the horizon; the next samples
  decide. Three that agree, over half a second for a gap and over two seconds for a new epoch, are believed, unless a
  sample that takes the present clock further came between them: such a one shows that the present clock is alive, and
  what is held behind it or more than a minute ahead of it is dropped;
- it is *stale* when its stream merely lags behind the horizon, or when the number of its message tells that it was sent
  before what took the clock further.

So no wrong timestamp, and no wrong batch shorter than that, makes what follows stale.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from dataclasses import dataclass
from enum import Enum, auto
from operator import itemgetter
from typing import Any, Final, TypeAlias

from tickfix.api.events import Fix, Scan
from tickfix.kernel.measurements import Measurement
from tickfix.kernel.snapshot import ClockSnapshot, HeldSnapshot

EPOCH_JUMP_NS: Final = 60_000_000_000
"""A jump ahead by more than this is not a gap but a new epoch."""
_MIN_CONFIRMING: Final = 3
_GAP_SPAN_NS: Final = 500_000_000
_EPOCH_SPAN_NS: Final = 2_000_000_000
_MAX_HELD: Final = 8_192
"""Samples held at most; a scan counts for one and a quarter of its readings. Two seconds of a phone are far less."""
_MAX_STREAMS: Final = 64
"""Streams whose newest times are known at most: sources of scans and fixes have any name."""


class TimestampVerdict(Enum):
    """What to do with a time."""

    FOLLOW = auto()
    HOLD_AHEAD = auto()
    HOLD_BEHIND = auto()
    STALE = auto()


@dataclass(frozen=True, slots=True)
class HeldMeasurement:
    """A sample that waits for others to confirm its time."""

    t_ns: int
    stream: str
    measurement: Measurement
    ahead: bool


_HeldEntry: TypeAlias = tuple[int, int, HeldMeasurement]
"""Time, order of arrival, sample: what is held stands in lists sorted by these, so that none has to be searched."""


class DeviceClock:
    """Judges the times of one device's samples within one epoch.

    Args:
        horizon_ns: how far behind the last closed tick an event may lie.
        steady: streams that do not pause while they are on.
    """

    def __init__(self, horizon_ns: int, steady: frozenset[str] = frozenset()) -> None:
        """Begin an epoch that has seen nothing."""
        self._horizon_ns = horizon_ns
        self._steady = steady
        self.jump_ns = min(5_000_000_000, horizon_ns // 2)
        self.latest_ns: int | None = None
        self.last_ns: dict[str, int] = {}
        self._ahead: list[_HeldEntry] = []
        self._voting: list[_HeldEntry] = []
        self._behind: list[_HeldEntry] = []
        self._behind_of: dict[str, list[_HeldEntry]] = {}
        self._order = 0
        self._room = _MAX_HELD

    @property
    def reach_ns(self) -> int | None:
        """The newest time that follows without being confirmed, None before the first."""
        if self.latest_ns is None:
            return None
        # While motion sensors run, samples come many times a second, so that a leap of seconds is suspicious. A phone
        # that only scans is silent for up to a minute, and a scan after such a pause must not be held.
        since_ns = self.latest_ns - EPOCH_JUMP_NS
        steady = any(self.last_ns.get(stream, since_ns - 1) >= since_ns for stream in self._steady)
        return self.latest_ns + (self.jump_ns if steady else EPOCH_JUMP_NS)

    def classify(self, t_ns: int, stream: str, limit_ns: int | None) -> TimestampVerdict:
        """Judge a time; ``limit_ns`` is the horizon, None as long as there is none."""
        reach_ns = self.reach_ns
        if reach_ns is None:
            return TimestampVerdict.FOLLOW
        if t_ns > reach_ns:
            return TimestampVerdict.HOLD_AHEAD
        if limit_ns is None or t_ns >= limit_ns:
            return TimestampVerdict.FOLLOW
        # Behind the horizon there are two explanations. Its own stream has not come much further: it merely lags. Its
        # stream has run ahead of it by more than the horizon (or is new): then either this sample is wrong, or the
        # clock restarted, which the next samples decide. Other streams do not tell: their delays differ.
        last_ns = self.last_ns.get(stream)
        return (
            TimestampVerdict.HOLD_BEHIND
            if last_ns is None or last_ns - t_ns > self._horizon_ns
            else TimestampVerdict.STALE
        )

    def follow(self, t_ns: int, stream: str) -> int:
        """Note a time that follows; return how many held samples it contradicts and so drops."""
        advances = self.latest_ns is None or t_ns > self.latest_ns
        if advances:
            self.latest_ns = t_ns
        if t_ns > self.last_ns.get(stream, -1):
            self._note_stream_time(t_ns, stream)
        if not self._ahead and not self._behind:
            return 0
        if advances:
            # The present clock is alive. So what waits behind it is no new epoch, nor is what waits over a minute
            # ahead. What waits less far ahead may still be reached (a gap), so it stays, but must be confirmed again by
            # samples that come from now on: those held so far have lost their vote.
            self._voting.clear()
            contradicted = self._behind + self._ahead[bisect_left(self._ahead, (t_ns + EPOCH_JUMP_NS + 1,)) :]
        else:
            # A sample that follows without advancing shows only that its own stream still uses the present clock.
            contradicted = list(self._behind_of.get(stream, ()))
        if contradicted:
            self._drop(contradicted)
        return len(contradicted)

    def hold(self, held: HeldMeasurement) -> int:
        """Keep a sample until others confirm it; return how many had to be dropped to keep the number bounded."""
        self._store(held, votes=True)
        if self._room >= 0:
            return 0
        # The older half together, so that a sample costs the same however many are held.
        oldest = sorted(self._ahead + self._behind, key=itemgetter(1))
        dropped = oldest[: max(1, len(oldest) // 2)]
        self._drop(dropped)
        return len(dropped)

    def release_caught_up(self) -> list[HeldMeasurement]:
        """Return, and no longer hold, what lies ahead but within reach now."""
        reach_ns = self.reach_ns
        if not self._ahead or reach_ns is None or self._ahead[0][0] > reach_ns:
            return []
        return self._release(self._ahead[: bisect_left(self._ahead, (reach_ns + 1,))])

    def release_confirmed(self, newest: HeldMeasurement) -> tuple[list[HeldMeasurement], bool]:
        """Return the held samples that ``newest`` confirms, and whether they begin a new epoch; often none."""
        assert self.latest_ns is not None  # noqa: S101 - nothing is held before something was followed
        # Votes are the held samples within a minute of the newest one, on the same side of the present clock and, ahead
        # of it, on the same side of the minute that separates a gap from a new epoch: a gap must not be confirmed by
        # samples of a new epoch, nor the other way round.
        votes, far_ns = self._voting if newest.ahead else self._behind, self.latest_ns + EPOCH_JUMP_NS
        since_ns, until_ns = newest.t_ns - EPOCH_JUMP_NS, newest.t_ns + EPOCH_JUMP_NS
        gap = newest.ahead and newest.t_ns <= far_ns
        if gap:
            until_ns = min(until_ns, far_ns)
        elif newest.ahead:
            since_ns = max(since_ns, far_ns + 1)
        begin, end = bisect_left(votes, (since_ns,)), bisect_left(votes, (until_ns + 1,))
        if end - begin < _MIN_CONFIRMING:
            return [], False
        # Three votes are not enough by themselves: a batch with one wrong time repeats it for all its samples. So they
        # must span half a second (two for a new epoch, which costs a track its past), and one must lie strictly between
        # the oldest and the newest, so that two groups of equal times do not count as three samples that agree.
        oldest_ns, newest_ns = votes[begin][0], votes[end - 1][0]
        between = bisect_left(votes, (newest_ns,)) - bisect_left(votes, (oldest_ns + 1,))
        if between < 1 or newest_ns - oldest_ns < (_GAP_SPAN_NS if gap else _EPOCH_SPAN_NS):
            return [], False
        if not gap:
            return self._release(votes[begin:end]), True
        # The clock is there now: whatever waits before it, or within reach of it, has its place.
        return self._release(self._ahead[: bisect_left(self._ahead, (newest_ns + self.jump_ns + 1,))]), False

    def release_all(self) -> list[HeldMeasurement]:
        """Return, and no longer hold, everything held."""
        return self._release(self._ahead + self._behind)

    @property
    def held_count(self) -> int:
        """How many samples are held."""
        return len(self._ahead) + len(self._behind)

    def snapshot(self) -> ClockSnapshot:
        """Return what the clock has shown, as a value."""
        voting = {order for _, order, _ in self._voting}
        held = sorted(self._ahead + self._behind, key=itemgetter(1))
        return ClockSnapshot(
            latest_ns=self.latest_ns,
            last_ns=tuple(self.last_ns.items()),
            held=tuple(_held_snapshot(held, votes=not held.ahead or order in voting) for _, order, held in held),
        )

    def restore(self, kept: ClockSnapshot) -> None:
        """Become what ``kept`` says."""
        self.latest_ns, self.last_ns = kept.latest_ns, dict(kept.last_ns)
        for waiting in kept.held:
            content = next(c for c in (waiting.scan, waiting.fix, waiting.row) if c is not None)
            measurement = Measurement(waiting.t_ns, waiting.stream, content)
            self._store(HeldMeasurement(waiting.t_ns, waiting.stream, measurement, waiting.ahead), votes=waiting.votes)

    def _note_stream_time(self, t_ns: int, stream: str) -> None:
        """Note the newest time of a stream; whoever invents streams pushes out the oldest, never the steady ones."""
        self.last_ns[stream] = t_ns
        if len(self.last_ns) > _MAX_STREAMS:
            del self.last_ns[next(name for name in self.last_ns if name not in self._steady)]

    def _store(self, held: HeldMeasurement, *, votes: bool) -> None:
        self._order += 1
        self._room -= _held_weight(held)
        entry = (held.t_ns, self._order, held)
        if held.ahead:
            insort(self._ahead, entry)
            if votes:
                insort(self._voting, entry)
        else:
            insort(self._behind, entry)
            insort(self._behind_of.setdefault(held.stream, []), entry)

    def _release(self, entries: list[_HeldEntry]) -> list[HeldMeasurement]:
        self._drop(entries)
        return sorted((held for _, _, held in entries), key=lambda h: (h.t_ns, h.stream))

    def _drop(self, entries: list[_HeldEntry]) -> None:
        self._room += sum(_held_weight(held) for _, _, held in entries)
        gone = {order for _, order, _ in entries}
        for kept in (self._ahead, self._voting, self._behind):
            _remove_entries(kept, entries, gone)
        for stream in {held.stream for _, _, held in entries if not held.ahead}:
            _remove_entries(self._behind_of[stream], entries, gone)
            if not self._behind_of[stream]:
                del self._behind_of[stream]


def _remove_entries(kept: list[_HeldEntry], entries: list[_HeldEntry], gone: set[int]) -> None:
    """Remove entries from a sorted list; few are found faster one by one."""
    if 16 * len(entries) > len(kept):
        kept[:] = [entry for entry in kept if entry[1] not in gone]
        return
    for entry in entries:
        place = bisect_left(kept, entry)
        if place < len(kept) and kept[place] is entry:
            del kept[place]


def _held_weight(held: HeldMeasurement) -> int:
    content: Any = held.measurement.content if isinstance(held.measurement, Measurement) else None
    return 1 + len(content) // 4 if isinstance(content, Scan) else 1


def _held_snapshot(held: HeldMeasurement, *, votes: bool) -> HeldSnapshot:
    content = held.measurement.content
    return HeldSnapshot(
        t_ns=held.t_ns,
        stream=held.stream,
        row=content if isinstance(content, tuple) else (),
        scan=content if isinstance(content, Scan) else None,
        fix=content if isinstance(content, Fix) else None,
        ahead=held.ahead,
        votes=votes,
    )
