"""A device's clock as its samples show it: which times to follow, which to doubt, and when it has started anew.

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

from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Final

from tickfix.api.events import Fix, Scan
from tickfix.kernel.measurements import Item
from tickfix.kernel.snapshot import ClockSnapshot, HeldSnapshot, VotesSnapshot

LEAP_NS: Final = 60_000_000_000
"""A jump ahead by more than this is not a gap but a new epoch."""
_AGREEING: Final = 3
_GAP_SPAN_NS: Final = 500_000_000
_EPOCH_SPAN_NS: Final = 2_000_000_000
_HELD_MOST: Final = 20_000
_GAP: Final = (True, False)
"""The side of what lies ahead, but not so far that a new epoch would begin; see :meth:`DeviceClock._side`."""


class Verdict(Enum):
    """What to do with a time."""

    FOLLOW = auto()
    HOLD_AHEAD = auto()
    HOLD_BEHIND = auto()
    STALE = auto()


@dataclass(frozen=True, slots=True)
class Held:
    """A sample that waits for others to confirm its time."""

    t_ns: int
    stream: str
    item: Item
    ahead: bool


@dataclass(slots=True)
class Votes:
    """Held samples that may confirm each other: all behind, within a minute ahead, or further ahead."""

    held: list[Held] = field(default_factory=list)
    oldest_ns: int = 2**63
    newest_ns: int = -1

    def add(self, held: Held) -> None:
        """Take another one in."""
        self.held.append(held)
        self.oldest_ns, self.newest_ns = min(self.oldest_ns, held.t_ns), max(self.newest_ns, held.t_ns)


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
        self._held: list[Held] = []
        self._held_ahead_from_ns: int | None = None
        self._votes: dict[tuple[bool, bool], Votes] = {}

    @property
    def reach_ns(self) -> int | None:
        """The newest time that follows without being confirmed, None before the first."""
        if self.latest_ns is None:
            return None
        since_ns = self.latest_ns - LEAP_NS
        steady = any(self.last_ns.get(stream, -1) >= since_ns for stream in self._steady)
        return self.latest_ns + (self.jump_ns if steady else LEAP_NS)

    def judge(self, t_ns: int, stream: str, limit_ns: int | None) -> Verdict:
        """Judge a time; ``limit_ns`` is the horizon, None as long as there is none."""
        reach_ns = self.reach_ns
        if reach_ns is None:
            return Verdict.FOLLOW
        if t_ns > reach_ns:
            return Verdict.HOLD_AHEAD
        if limit_ns is None or t_ns >= limit_ns:
            return Verdict.FOLLOW
        last_ns = self.last_ns.get(stream)
        return Verdict.HOLD_BEHIND if last_ns is None or last_ns - t_ns > self._horizon_ns else Verdict.STALE

    def follow(self, t_ns: int, stream: str) -> int:
        """Note a time that follows; return how many held samples it contradicts and so drops."""
        advances = self.latest_ns is None or t_ns > self.latest_ns
        if advances:
            self.latest_ns = t_ns
        if t_ns > self.last_ns.get(stream, -1):
            self.last_ns[stream] = t_ns
        if not self._held:
            return 0
        if advances:
            self._votes.clear()
            contradicted = [h for h in self._held if not h.ahead or h.t_ns > t_ns + LEAP_NS]
        else:
            contradicted = [h for h in self._held if not h.ahead and h.stream == stream]
        if contradicted:
            self._take(contradicted)
        return len(contradicted)

    def hold(self, held: Held) -> int:
        """Keep a sample until others confirm it; return how many had to be dropped to keep the number bounded."""
        self._held.append(held)
        self._votes.setdefault(self._side(held), Votes()).add(held)
        if held.ahead and (self._held_ahead_from_ns is None or held.t_ns < self._held_ahead_from_ns):
            self._held_ahead_from_ns = held.t_ns
        if len(self._held) <= _HELD_MOST:
            return 0
        self._take(self._held[:1])
        return 1

    def caught_up(self) -> list[Held]:
        """Return, and no longer hold, what lies ahead but within reach now."""
        reach_ns = self.reach_ns
        if self._held_ahead_from_ns is None or reach_ns is None or self._held_ahead_from_ns > reach_ns:
            return []
        return self._take([h for h in self._held if h.ahead and h.t_ns <= reach_ns])

    def confirmed(self, newest: Held) -> tuple[list[Held], bool]:
        """Return the held samples that ``newest`` confirms, and whether they begin a new epoch; often none."""
        side = self._side(newest)
        votes = self._votes[side]
        anew = side != _GAP
        span_ns = _EPOCH_SPAN_NS if anew else _GAP_SPAN_NS
        if votes.newest_ns - votes.oldest_ns < span_ns:
            return [], False
        agreeing = [h for h in votes.held if abs(h.t_ns - newest.t_ns) <= LEAP_NS]
        instants = sorted({h.t_ns for h in agreeing})
        if len(instants) < _AGREEING or instants[-1] - instants[0] < span_ns:
            return [], False
        if anew:
            return self._take(agreeing), True
        # The clock is there now: whatever waits before it, or within reach of it, has its place.
        reach_ns = instants[-1] + self.jump_ns
        return self._take([h for h in self._held if h.ahead and h.t_ns <= reach_ns]), False

    def remaining(self) -> list[Held]:
        """Return, and no longer hold, everything held."""
        return self._take(list(self._held))

    @property
    def holds(self) -> int:
        """How many samples are held."""
        return len(self._held)

    def snapshot(self) -> ClockSnapshot:
        """Return what the clock has shown, as a value."""
        sides = {id(held): side for side, votes in self._votes.items() for held in votes.held}
        return ClockSnapshot(
            latest_ns=self.latest_ns,
            last_ns=tuple(self.last_ns.items()),
            held=tuple(_kept(held, sides.get(id(held))) for held in self._held),
            votes=tuple(VotesSnapshot(side, v.oldest_ns, v.newest_ns) for side, v in self._votes.items()),
        )

    def restore(self, kept: ClockSnapshot) -> None:
        """Become what ``kept`` says."""
        self.latest_ns, self.last_ns = kept.latest_ns, dict(kept.last_ns)
        self._votes = {votes.side: Votes([], votes.oldest_ns, votes.newest_ns) for votes in kept.votes}
        for waiting in kept.held:
            content = next(c for c in (waiting.scan, waiting.fix, waiting.row) if c is not None)
            item = Item(waiting.t_ns, waiting.stream, content)
            held = Held(waiting.t_ns, waiting.stream, item, waiting.ahead)
            self._held.append(held)
            if waiting.side is not None:
                self._votes[waiting.side].held.append(held)
        self._held_ahead_from_ns = min((h.t_ns for h in self._held if h.ahead), default=None)

    def _side(self, held: Held) -> tuple[bool, bool]:
        assert self.latest_ns is not None  # noqa: S101 - nothing is held before something was followed
        return held.ahead, held.ahead and held.t_ns > self.latest_ns + LEAP_NS

    def _take(self, taken: list[Held]) -> list[Held]:
        gone = {id(h) for h in taken}
        self._held = [h for h in self._held if id(h) not in gone]
        self._held_ahead_from_ns = min((h.t_ns for h in self._held if h.ahead), default=None)
        for votes in self._votes.values():
            votes.held = [h for h in votes.held if id(h) not in gone]
        return sorted(taken, key=lambda h: (h.t_ns, h.stream))


def _kept(held: Held, side: tuple[bool, bool] | None) -> HeldSnapshot:
    content = held.item.content
    return HeldSnapshot(
        t_ns=held.t_ns,
        stream=held.stream,
        row=content if isinstance(content, tuple) else (),
        scan=content if isinstance(content, Scan) else None,
        fix=content if isinstance(content, Fix) else None,
        ahead=held.ahead,
        side=side,
    )
