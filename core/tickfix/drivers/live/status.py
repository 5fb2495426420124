"""What an engine tells of itself: copies that the loop makes, read by the thread of the ports at any time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, Protocol

import tickfix
from tickfix.config import Config
from tickfix.plugins import Registry
from tickfix.ports import Clock, Hub

_EVERY_NS: Final = 200_000_000
_STUCK_S: Final = 2.0
_MOST: Final = 10_000


class Reporting(Protocol):
    """An engine that can say how it is."""

    def report(self) -> dict[str, Any]:
        """Return what an operator wants to know, as plain values."""

    def devices(self, most: int) -> tuple[dict[str, Any], ...]:
        """Return how far each device has come, ``most`` of them."""


def about(
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
        "version": tickfix.__version__,
        "pipelines": pipelines,
        "plugins": [
            {"kind": o.kind, "name": o.name, "distribution": o.distribution, "version": o.version}
            for o in registry.offers
        ],
        "configuration": config.text,
        "notes": list(notes),
    }


class Status:
    """Answers the questions of the control port.

    Args:
        about: what never changes, see :func:`about`.
    """

    def __init__(self, about: Mapping[str, Any], clock: Clock | None = None) -> None:
        """Begin before the engine does."""
        self._about = about
        self._clock = Clock() if clock is None else clock
        self._began_ns = self._clock.monotonic_ns()
        self._taken_ns = 0
        self._state: Mapping[str, Any] = {}
        self._devices: tuple[Mapping[str, Any], ...] = ()
        self.hub: Hub | None = None

    def look(self, engine: Reporting) -> None:
        """Copy what the engine says of itself, a few times a second; called by the loop."""
        now_ns = self._clock.monotonic_ns()
        if now_ns - self._taken_ns >= _EVERY_NS:
            self._state, self._devices = engine.report(), engine.devices(_MOST)
            self._taken_ns = now_ns

    def describe(self, what: str, args: Mapping[str, Any]) -> Any:
        """Answer a question; quick, and safe from any thread.

        Raises:
            ValueError: for a question that is none.
        """
        del args
        if what == "status":
            return self._status()
        if what == "health":
            return self._health()
        if what == "counters":
            return {"engine": dict(self._state), "ports": self._ports()}
        if what == "devices":
            return list(self._devices)
        if what in ("pipelines", "plugins", "configuration"):
            return self._about[what]
        raise ValueError(f"what: found {what!r}, expected status, health, counters, devices, pipelines or plugins")

    def _status(self) -> dict[str, Any]:
        ports, state = self._ports(), dict(self._state)
        primary = state.pop("primary", "")
        failures = state.get("failures", {})
        return {
            "run": self._about["run"],
            "site": self._about["site"],
            "version": self._about["version"],
            "uptime_s": (self._clock.monotonic_ns() - self._began_ns) * 1e-9,
            **state,
            "intake": ports.get("intake", {}).get("outcomes", {}),
            "publications": ports.get("publications", {}),
            "pipelines": [
                {"name": p["name"], "primary": p["name"] == primary, "state": p.get("state", "running")}
                for p in self._about["pipelines"]
            ],
            "failures": failures,
            "notes": list(self._about["notes"]),
        }

    def _health(self) -> dict[str, Any]:
        silence_s = (self._clock.monotonic_ns() - self._taken_ns) * 1e-9 if self._taken_ns else 0.0
        problems = [*self._about["notes"]]
        if silence_s > _STUCK_S:
            problems.append(f"the loop has been silent for {silence_s:.1f} s")
        if self._state.get("overload"):
            problems.append(str(self._state["overload"]))
        return {"ok": not problems, "problems": problems, "loop_age_s": silence_s}

    def _ports(self) -> dict[str, Any]:
        return {} if self.hub is None else self.hub.counters()
