"""What an engine reports of itself on the control port, and the histogram in which it keeps durations."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final, Protocol

from tickfix.config import Config
from tickfix.ports import ASK_LOOP, Clock, Hub
from tickfix.registry import Registry
from tickfix.version import __version__

_PER_DECADE: Final = 40
_SMALLEST_MS: Final = 1e-3
_BUCKETS: Final = 11 * _PER_DECADE + 2


class DurationHistogram:
    """Counts durations in buckets that grow by 6 %, from a microsecond to a day; quantiles are as exact as that."""

    __slots__ = ("_buckets", "count", "max_ms")

    def __init__(self) -> None:
        """Begin empty."""
        self._buckets = [0] * _BUCKETS
        self.count = 0
        self.max_ms = 0.0

    def add(self, ms: float) -> None:
        """Count a duration; one below zero counts as zero."""
        place = 0 if ms < _SMALLEST_MS else 1 + int(math.log10(ms / _SMALLEST_MS) * _PER_DECADE)
        self._buckets[min(place, _BUCKETS - 1)] += 1
        self.count += 1
        self.max_ms = max(self.max_ms, ms)

    def quantile_ms(self, q: float) -> float:
        """Return the upper end of the bucket in which the quantile lies, at most the greatest; 0 when empty."""
        wanted, seen = q * self.count, 0
        for place, n in enumerate(self._buckets):
            seen += n
            if n and seen >= wanted and place == _BUCKETS - 1:
                return self.max_ms
            if n and seen >= wanted:
                return min(self.max_ms, _SMALLEST_MS * 10 ** (place / _PER_DECADE))
        return 0.0

    def summary(self) -> dict[str, float]:
        """Return p50, p99 and max in milliseconds, and the count."""
        return {
            "p50": self.quantile_ms(0.5),
            "p99": self.quantile_ms(0.99),
            "max": self.max_ms,
            "count": self.count,
        }


_MAX_AGE_NS: Final = 200_000_000
_STALE_S: Final = 2.0
_MAX_DEVICES: Final = 10_000
LOOP_QUERIES: Final = frozenset({"status", "counters", "devices"})
"""Queries whose answers need the loop."""


class StatusSource(Protocol):
    """An engine that can report on itself."""

    @property
    def overload(self) -> str | None:
        """Why new devices are refused, None when all is well."""

    def report(self) -> dict[str, Any]:
        """Return counters and durations as plain values."""

    def devices(self, most: int) -> tuple[dict[str, Any], ...]:
        """Return how far each device has come, at most ``most`` of them."""


def static_status(
    config: Config,
    registry: Registry,
    run: str,
    site: str,
    names: Sequence[str],
    left_out: Mapping[str, str],
    notes: Sequence[str],
) -> dict[str, Any]:
    """Return what never changes of an engine.

    Args:
        run: by which listeners know it.
        site: name of the site.
        names: of the pipelines that run.
        left_out: why others do not, by name.
        notes: what an operator must know of it.
    """
    pipelines = []
    for choice in config.pipelines:
        stages = {c.offer.kind: c.offer.label for c in choice.choices}
        state = f"left out: {left_out[choice.name]}" if choice.name in left_out else "running"
        if choice.name in names or choice.name in left_out:
            pipelines.append({"name": choice.name, "state": state} | stages)
    return {
        "run": run,
        "site": site,
        "version": __version__,
        "pipelines": pipelines,
        "plugins": [
            {"kind": o.kind, "name": o.name, "distribution": o.distribution, "version": o.version}
            for o in registry.offers
        ],
        "configuration": config.text,
        "notes": list(notes),
    }


class EngineStatus:
    """Answers the queries of the control port.

    Counters of ten thousand devices take tens of milliseconds to collect, and only the loop's thread may read them. So
    they are collected when they are asked for, and at most five times a second: the port's thread answers with what it
    has if that is recent, and otherwise leaves the query to the loop (:data:`~tickfix.ports.ASK_LOOP`). If the loop
    hangs, the port's thread answers with the last values rather than not at all, and ``health`` says so.

    Args:
        static_status: what never changes, see :func:`static_status`.
        clock: monotonic.
    """

    def __init__(self, static_status: Mapping[str, Any], clock: Clock | None = None) -> None:
        """Begin before the engine does."""
        self._static_status = static_status
        self._clock = Clock() if clock is None else clock
        self._started_ns = self._clock.monotonic_ns()
        # Each of these is replaced as a whole, so that the port's thread always reads values of one instant.
        self._last_round: tuple[int, str | None] | None = None
        self._report: tuple[int, Mapping[str, Any]] = (0, {})
        self._devices: tuple[int, Sequence[Mapping[str, Any]]] = (0, ())
        self.hub: Hub | None = None

    def round_ended(self, engine: StatusSource) -> None:
        """Take note that the loop is alive; called by the loop after each round, and cheap."""
        self._last_round = self._clock.monotonic_ns(), engine.overload

    def answer(self, what: str, engine: StatusSource) -> Any:
        """Answer a query that was left to the loop; called by the loop."""
        now_ns = self._clock.monotonic_ns()
        if what == "devices" and not self._is_recent(self._devices[0], now_ns):
            self._devices = now_ns, engine.devices(_MAX_DEVICES)
        elif what != "devices" and not self._is_recent(self._report[0], now_ns):
            self._report = now_ns, engine.report()
        return self._cached(what)

    def describe(self, what: str, args: Mapping[str, Any]) -> Any:
        """Answer a query at once, from any thread; :data:`~tickfix.ports.ASK_LOOP` where the loop has to.

        Raises:
            ValueError: for an unknown query.
        """
        del args
        if what == "health":
            return self._health()
        if what in LOOP_QUERIES:
            collected_ns = (self._devices if what == "devices" else self._report)[0]
            recent = self._is_recent(collected_ns, self._clock.monotonic_ns())
            return self._cached(what) if recent or self._loop_age_s > _STALE_S else ASK_LOOP
        if what in ("pipelines", "plugins", "configuration"):
            return self._static_status[what]
        raise ValueError(f"what: found {what!r}, expected status, health, counters, devices, pipelines or plugins")

    def _cached(self, what: str) -> Any:
        if what == "devices":
            return list(self._devices[1])
        return self._status() if what == "status" else {"engine": dict(self._report[1]), "ports": self._ports()}

    @staticmethod
    def _is_recent(collected_ns: int, now_ns: int) -> bool:
        return collected_ns > 0 and now_ns - collected_ns < _MAX_AGE_NS

    @property
    def _loop_age_s(self) -> float:
        """Seconds since the last round ended, 0 before the first."""
        last = self._last_round
        return 0.0 if last is None else (self._clock.monotonic_ns() - last[0]) * 1e-9

    def _status(self) -> dict[str, Any]:
        ports, state = self._ports(), dict(self._report[1])
        primary = state.pop("primary", "")
        failures = state.get("failures", {})
        return {
            "run": self._static_status["run"],
            "site": self._static_status["site"],
            "version": self._static_status["version"],
            "uptime_s": (self._clock.monotonic_ns() - self._started_ns) * 1e-9,
            **state,
            "intake": ports.get("intake", {}).get("outcomes", {}),
            "publications": ports.get("publications", {}),
            "pipelines": [
                {"name": p["name"], "primary": p["name"] == primary, "state": p.get("state", "running")}
                for p in self._static_status["pipelines"]
            ],
            "failures": failures,
            "notes": list(self._static_status["notes"]),
        }

    def _health(self) -> dict[str, Any]:
        age_s, overload = self._loop_age_s, None if self._last_round is None else self._last_round[1]
        problems = [*self._static_status["notes"]]
        if age_s > _STALE_S:
            problems.append(f"the loop has been silent for {age_s:.1f} s")
        if overload:
            problems.append(overload)
        return {"ok": not problems, "problems": problems, "loop_age_s": age_s}

    def _ports(self) -> dict[str, Any]:
        return {} if self.hub is None else self.hub.counters()
