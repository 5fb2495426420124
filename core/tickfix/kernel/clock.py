"""A device's clock as its samples show it: which times to follow, which to doubt, and when it has started anew.

Phones' clocks start anywhere, drift, step and reboot, and single samples carry times that are plainly wrong. Every
sample is judged by itself, so that batching cannot matter:

- it *follows* when it lies within the horizon behind, or at most ``jump_ns`` ahead of, what was seen so far;
- it is *held* when it jumps further ahead, or when its own stream runs backwards beyond the horizon; the next samples
  decide. Three that agree, over half a second for a gap and over two seconds for a new epoch, are believed. A sample
  that the present clock's next ones contradict is dropped;
- it is *stale* when its stream merely lags behind the horizon.

So no wrong timestamp, and no wrong batch shorter than that, makes what follows stale.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from typing import Any, Final

LEAP_NS: Final = 60_000_000_000
"""A jump ahead by more than this is not a gap but a new epoch."""
_AGREEING: Final = 3
_GAP_SPAN_NS: Final = 500_000_000
_EPOCH_SPAN_NS: Final = 2_000_000_000
_HELD_MOST: Final = 20_000


class Verdict(Enum):
    """What to do with a time."""

    FOLLOW = auto()
    HOLD_AHEAD = auto()
    HOLD_BEHIND = auto()
    STALE = auto()


@dataclass(frozen=True, slots=True)
class Held:
    """A sample that waits for others to confirm its time; ``item`` is the caller's."""

    t_ns: int
    stream: str
    item: Any
    ahead: bool


class DeviceClock:
    """Judges the times of one device's samples within one epoch.

    Args:
        horizon_ns: how far behind the last closed tick an event may lie.
    """

    def __init__(self, horizon_ns: int) -> None:
        """Begin an epoch that has seen nothing."""
        self._horizon_ns = horizon_ns
        self.jump_ns = min(5_000_000_000, horizon_ns // 2)
        self.latest_ns: int | None = None
        self.last_ns: dict[str, int] = {}
        self._held: list[Held] = []
        self._held_ahead_from_ns: int | None = None

    def judge(self, t_ns: int, stream: str, limit_ns: int | None) -> Verdict:
        """Judge a time; ``limit_ns`` is the horizon, None as long as there is none."""
        if self.latest_ns is None:
            return Verdict.FOLLOW
        if t_ns > self.latest_ns + self.jump_ns:
            return Verdict.HOLD_AHEAD
        if limit_ns is None or t_ns >= limit_ns:
            return Verdict.FOLLOW
        last_ns = self.last_ns.get(stream)
        return Verdict.HOLD_BEHIND if last_ns is None or last_ns - t_ns > self._horizon_ns else Verdict.STALE

    def follow(self, t_ns: int, stream: str) -> int:
        """Note a time that follows; return how many held samples of its stream it contradicts and so drops."""
        if self.latest_ns is None or t_ns > self.latest_ns:
            self.latest_ns = t_ns
        if t_ns > self.last_ns.get(stream, -1):
            self.last_ns[stream] = t_ns
        if not self._held:
            return 0
        kept = [h for h in self._held if h.ahead or h.stream != stream]
        dropped = len(self._held) - len(kept)
        self._held = kept
        return dropped

    def hold(self, held: Held) -> int:
        """Keep a sample until others confirm it; return how many had to be dropped to keep the number bounded."""
        self._held.append(held)
        if held.ahead and (self._held_ahead_from_ns is None or held.t_ns < self._held_ahead_from_ns):
            self._held_ahead_from_ns = held.t_ns
        if len(self._held) <= _HELD_MOST:
            return 0
        del self._held[0]
        return 1

    def caught_up(self) -> list[Held]:
        """Return, and no longer hold, what lies ahead but within reach now."""
        if self._held_ahead_from_ns is None or self.latest_ns is None:
            return []
        reach_ns = self.latest_ns + self.jump_ns
        if self._held_ahead_from_ns > reach_ns:
            return []
        return self._take([h for h in self._held if h.ahead and h.t_ns <= reach_ns])

    def confirmed(self, newest: Held) -> tuple[list[Held], bool]:
        """Return the held samples that ``newest`` confirms, and whether they begin a new epoch; often none."""
        assert self.latest_ns is not None  # noqa: S101 - nothing is held before something was followed
        agreeing = [
            h
            for h in self._held
            if h.ahead == newest.ahead and abs(h.t_ns - newest.t_ns) <= _EPOCH_SPAN_NS + self.jump_ns
        ]
        instants = sorted({h.t_ns for h in agreeing})
        anew = not newest.ahead or instants[0] > self.latest_ns + LEAP_NS
        span_ns = _EPOCH_SPAN_NS if anew else _GAP_SPAN_NS
        if len(instants) < _AGREEING or instants[-1] - instants[0] < span_ns:
            return [], False
        return self._take(agreeing), anew

    def remaining(self) -> list[Held]:
        """Return, and no longer hold, everything held."""
        return self._take(list(self._held))

    @property
    def holds(self) -> int:
        """How many samples are held."""
        return len(self._held)

    def _take(self, taken: list[Held]) -> list[Held]:
        gone = {id(h) for h in taken}
        self._held = [h for h in self._held if id(h) not in gone]
        self._held_ahead_from_ns = min((h.t_ns for h in self._held if h.ahead), default=None)
        return sorted(taken, key=lambda h: (h.t_ns, h.stream))
