"""What an engine reports of itself on the control port, collected when it is asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, Protocol

from prometheus_client import CollectorRegistry, generate_latest

from tickfix.config import Config
from tickfix.ports import ASK_LOOP, Clock, Hub
from tickfix.registry import Registry
from tickfix.version import __version__

_MAX_AGE_NS: Final = 200_000_000
_STALE_S: Final = 2.0
_MAX_DEVICES: Final = 10_000
LOOP_QUERIES: Final = frozenset({"status", "counters", "devices", "metrics"})
"""Queries whose answers need the loop."""


class StatusSource(Protocol):
    """An engine that can report on itself."""

    @property
    def overload(self) -> str | None:
        """Why new devices are refused, None when all is well."""

    def report(self) -> dict[str, Any]:
        """Return counters and durations as plain values."""

    @property
    def metrics(self) -> CollectorRegistry:
        """Counters and durations, as metrics; to be collected on the loop's thread."""

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
        # Values are replaced as a whole, with the time of their collection, so that the port's thread always reads
        # values of one instant.
        self._last_round: tuple[int, str | None] | None = None
        self._collected: dict[str, tuple[int, Any]] = {"report": (0, {}), "devices": (0, ()), "metrics": (0, "")}
        self.hub: Hub | None = None

    def round_ended(self, engine: StatusSource) -> None:
        """Take note that the loop is alive; called by the loop after each round, and cheap."""
        self._last_round = self._clock.monotonic_ns(), engine.overload

    def answer(self, what: str, engine: StatusSource) -> Any:
        """Answer a query that was left to the loop; called by the loop."""
        now_ns, part = self._clock.monotonic_ns(), _part(what)
        if not self._is_recent(part, now_ns):
            if part == "report":
                value: Any = engine.report()
            elif part == "devices":
                value = engine.devices(_MAX_DEVICES)
            else:
                value = generate_latest(engine.metrics).decode()
            self._collected[part] = now_ns, value
        return self._last(what)

    def describe(self, what: str, args: Mapping[str, Any]) -> Any:
        """Answer a query at once, from any thread; :data:`~tickfix.ports.ASK_LOOP` where the loop has to.

        Raises:
            ValueError: for an unknown query.
        """
        del args
        if what == "health":
            return self._health()
        if what in LOOP_QUERIES:
            recent = self._is_recent(_part(what), self._clock.monotonic_ns())
            return self._last(what) if recent or self._loop_age_s > _STALE_S else ASK_LOOP
        if what in ("pipelines", "plugins", "configuration"):
            return self._static_status[what]
        raise ValueError(
            f"what: found {what!r}, expected status, health, counters, devices, metrics, pipelines or plugins"
        )

    def _last(self, what: str) -> Any:
        if what == "status":
            return self._status()
        _, value = self._collected[_part(what)]
        if what == "counters":
            return {"engine": dict(value), "ports": self._ports()}
        return list(value) if what == "devices" else value

    def _is_recent(self, part: str, now_ns: int) -> bool:
        collected_ns, _ = self._collected[part]
        return collected_ns > 0 and now_ns - collected_ns < _MAX_AGE_NS

    @property
    def _loop_age_s(self) -> float:
        """Seconds since the last round ended, 0 before the first."""
        last = self._last_round
        return 0.0 if last is None else (self._clock.monotonic_ns() - last[0]) * 1e-9

    def _status(self) -> dict[str, Any]:
        ports, state = self._ports(), dict(self._collected["report"][1])
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


def _part(what: str) -> str:
    """Return which of the collected values answers a query."""
    return what if what in ("devices", "metrics") else "report"
