"""What a pipeline costs: the time its stages took, stage by stage."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from tickfix.kernel import Pipeline, Stage


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """Sums that pool over walks.

    Attributes:
        pdr_ns, fingerprint_ns, filter_ns: time within the stages, that of a shared one counted in full for each of the
            pipelines it serves: what the pipeline would cost alone. Ticks folded again after a late event count again.
        ticks: of the published track.
        scans: calls of the fingerprint.
    """

    pdr_ns: int = 0
    fingerprint_ns: int = 0
    filter_ns: int = 0
    ticks: int = 0
    scans: int = 0

    @property
    def per_tick_us(self) -> float | None:
        """All stages, per published tick, µs."""
        total = self.pdr_ns + self.fingerprint_ns + self.filter_ns
        return total / self.ticks * 1e-3 if self.ticks else None

    @property
    def per_fix_us(self) -> float | None:
        """The fingerprint, per scan, µs."""
        return self.fingerprint_ns / self.scans * 1e-3 if self.scans else None


class Metered:
    """An algorithm whose calls are timed; all else of it shows through."""

    def __init__(self, algorithm: Any, clock_ns: Callable[[], int]) -> None:
        """Begin at nothing spent."""
        self._algorithm = algorithm
        self._clock_ns = clock_ns
        self.spent_ns = 0
        self.steps = 0

    def __getattr__(self, name: str) -> Any:
        """Return what the algorithm has."""
        return getattr(self._algorithm, name)

    def start(self, *args: Any) -> Any:
        """Start, timed."""
        return self._timed(self._algorithm.start, args)

    def step(self, *args: Any) -> Any:
        """Step, timed and counted."""
        self.steps += 1
        return self._timed(self._algorithm.step, args)

    def estimate(self, *args: Any) -> Any:
        """Estimate, timed."""
        return self._timed(self._algorithm.estimate, args)

    def _timed(self, call: Callable[..., Any], args: tuple[Any, ...]) -> Any:
        began = self._clock_ns()
        try:
            return call(*args)
        finally:
            self.spent_ns += self._clock_ns() - began


class Meter:
    """Pipelines whose stages are timed.

    Args:
        pipelines: any; those handed out compute the same.
        clock_ns: counts nanoseconds, of processor time best.
    """

    def __init__(self, pipelines: Sequence[Pipeline], clock_ns: Callable[[], int]) -> None:
        """Wrap each stage once, so that shared ones stay shared."""
        self._clock_ns = clock_ns
        self._metered: dict[str, Metered] = {}
        self.pipelines = tuple(
            replace(p, pdr=self._wrap(p.pdr), fingerprint=self._wrap(p.fingerprint), filter=self._wrapped(p.filter))
            for p in pipelines
        )

    def cost(self, pipeline: Pipeline, ticks: int) -> Cost:
        """Return what ``pipeline`` has spent so far on ``ticks`` published ticks."""
        pdr, fingerprint, filter_ = (
            None if stage is None else self._metered[stage.key]
            for stage in (pipeline.pdr, pipeline.fingerprint, pipeline.filter)
        )
        return Cost(
            pdr_ns=pdr.spent_ns if pdr else 0,
            fingerprint_ns=fingerprint.spent_ns if fingerprint else 0,
            filter_ns=filter_.spent_ns if filter_ else 0,
            ticks=ticks,
            scans=fingerprint.steps if fingerprint else 0,
        )

    def _wrap(self, stage: Stage | None) -> Stage | None:
        return None if stage is None else self._wrapped(stage)

    def _wrapped(self, stage: Stage) -> Stage:
        if stage.key not in self._metered:
            self._metered[stage.key] = Metered(stage.algorithm, self._clock_ns)
        return replace(stage, algorithm=self._metered[stage.key])
