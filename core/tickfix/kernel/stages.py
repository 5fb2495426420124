"""Calling a stage so that it can harm nobody: what it returns is checked, what it raises is caught and named."""

from __future__ import annotations

import dataclasses
import math
import re
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, TypeVar

import numpy as np

from tickfix.api.errors import PluginError
from tickfix.api.events import TICK_NS
from tickfix.api.packing import field_values_getter, pack, unpack
from tickfix.api.values import Belief, Component, Motion, Observation, Report
from tickfix.kernel.snapshot import FoldSnapshot

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Stage:
    """An algorithm in its place.

    Attributes:
        kind, name: what it is and which.
        key: equal for stages that compute the same: these are computed once.
        algorithm: the instance, built for the site.
    """

    kind: str
    name: str
    key: str
    algorithm: Any

    @property
    def label(self) -> str:
        """How messages call it."""
        return f"{self.kind} '{self.name}'"


@dataclass(frozen=True, slots=True)
class Pipeline:
    """A named choice of stages; pdr and fingerprint may be absent. The map is part of the filter's context."""

    name: str
    filter: Stage
    pdr: Stage | None = None
    fingerprint: Stage | None = None

    @property
    def key(self) -> str:
        """Equal for pipelines that say the same under the same name."""
        return "\n".join([self.name, *(stage.key for stage in self.stages)])

    @property
    def stages(self) -> tuple[Stage, ...]:
        """Those that it has, in the order in which they are called."""
        return tuple(stage for stage in (self.pdr, self.fingerprint, self.filter) if stage is not None)


@dataclass(frozen=True, slots=True)
class StageFailure:
    """A stage call that failed.

    Attributes:
        stage: label of the stage.
        what: the kind of error; part of the estimate.
        detail: the whole message; for logs, since it need not be the same everywhere.
    """

    stage: str
    what: str
    detail: str

    def __str__(self) -> str:
        """Return what an estimate says of it."""
        return f"{self.stage}: {self.what}"


class StageCaller:
    """Calls stages.

    Args:
        on_failure: told of each failure.
        on_call: told of each stage before it is called, and None when it has come back.
        strict: raise instead, for tests.
        repack: pack and unpack every state that a stage returns: slow, and finds states that do not survive it.
    """

    def __init__(
        self,
        on_failure: Callable[[StageFailure], None],
        *,
        on_call: Callable[[Stage | None], None] | None = None,
        strict: bool = False,
        repack: bool = False,
    ) -> None:
        """Keep how to react."""
        self._on_call = on_call
        self._on_failure = on_failure
        self._strict = strict
        self._repack = repack

    def __call__(self, stage: Stage, check: Callable[[Any], Any], call: Callable[..., Any], *args: Any) -> Any:
        """Return what ``call(*args)`` returned, checked by ``check``; or the :class:`StageFailure`."""
        self._notify(stage)
        try:
            return check(call(*args))
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a stage that calls sys.exit() must not end the others
            failure = StageFailure(stage.label, type(error).__name__, _error_text(error))
            if self._strict:
                raise PluginError(
                    stage.label, f"{failure.what}: {failure.detail}", "See the traceback above."
                ) from error
            self._on_failure(failure)
            return failure
        finally:
            self._notify(None)

    def call_or_none(self, stage: Stage, call: Callable[[], T]) -> T | None:
        """Return what ``call()`` returned; None where it failed, of which nobody is told: it will be done otherwise."""
        self._notify(stage)
        try:
            return call()
        except KeyboardInterrupt:
            raise
        except BaseException:  # noqa: BLE001 - as above
            return None
        finally:
            self._notify(None)

    def state(self, stage: Stage, state: Any) -> Any:
        """Check a state: no NaN in it, of the type the algorithm declares."""
        declared = stage.algorithm.State
        if not isinstance(state, declared):
            raise TypeError(f"returned a state of type {type(state).__name__}, expected {declared.__name__}")
        if has_nan(state):
            raise FloatingPointError("returned a state with NaN in it")
        return unpack(pack(state), declared) if self._repack else state

    def _notify(self, stage: Stage | None) -> None:
        if self._on_call is not None:
            self._on_call(stage)


@dataclass(frozen=True, slots=True)
class KernelSetup:
    """What all devices of a kernel share.

    Attributes:
        pipelines: in the order in which estimates of a tick come.
        call: how stages are called.
        measurements: counts single measurements by what became of them.
        seed: of all random streams.
        horizon_ns: how late an event may be.
        checkpoint_bytes: memory for one device's checkpoints.
    """

    pipelines: tuple[Pipeline, ...]
    call: StageCaller
    measurements: Counter[str]
    seed: int
    horizon_ns: int
    checkpoint_bytes: int

    def __post_init__(self) -> None:
        """Refuse a filter with an invalid lag at the start rather than at its first device."""
        for pipeline in self.pipelines:
            smoothing_ticks(pipeline.filter)

    @property
    def pdrs(self) -> tuple[Stage, ...]:
        """The distinct dead-reckoning stages, in the order of the pipelines that use them first."""
        return tuple({p.pdr.key: p.pdr for p in self.pipelines if p.pdr is not None}.values())

    @property
    def fingerprints(self) -> tuple[Stage, ...]:
        """The distinct fingerprint stages, in the order of the pipelines that use them first."""
        return tuple({p.fingerprint.key: p.fingerprint for p in self.pipelines if p.fingerprint is not None}.values())

    @property
    def horizon_ticks(self) -> int:
        """How many closed ticks can still change."""
        return self.horizon_ns // TICK_NS

    @property
    def lag_ticks(self) -> int:
        """The longest lag of the filters that smooth, 0 without one; ticks settle that much after the horizon."""
        return max((smoothing_ticks(pipeline.filter) or 0 for pipeline in self.pipelines), default=0)

    @property
    def fold_bytes(self) -> int:
        """The share of ``checkpoint_bytes`` of each fold."""
        return self.checkpoint_bytes // max(1, len(self.pdrs) + len(self.fingerprints) + len(self.pipelines))


def _error_text(error: BaseException) -> str:
    try:
        return str(error)
    except Exception:  # noqa: BLE001 - even its words may be a stage's code
        return "an error without words"


def packed_state(state: Any) -> bytes | None:
    """Return the bytes of a stage's state, None for one that has not begun."""
    return None if state is None else pack(state)


def checked_snapshot(call: StageCaller, stage: Stage, snapshot: Callable[[], FoldSnapshot]) -> FoldSnapshot | None:
    """Return a fold's snapshot; None, and a failure of the stage, where its state cannot be packed."""
    kept = call(stage, lambda made: made, snapshot)
    return kept if isinstance(kept, FoldSnapshot) else None


def unpacked_state(packed: bytes | None, stage: Stage) -> Any:
    """Return the stage's state that was packed.

    Raises:
        ValueError: when the bytes are no such state.
    """
    return None if packed is None else unpack(packed, stage.algorithm.State)


def smoothing_ticks(stage: Stage) -> int | None:
    """Return how many ticks after a tick the filter smooths it with, None for a filter that does not smooth.

    Raises:
        PluginError: when its ``lag_s`` is missing or no number of seconds in range.
    """
    if not hasattr(stage.algorithm, "smooth"):
        return None
    lag_s: Any = getattr(stage.algorithm, "lag_s", None)
    is_number = isinstance(lag_s, int | float | np.integer | np.floating) and not isinstance(lag_s, bool)
    if not is_number or not 0 <= lag_s <= MAX_SMOOTHING_LAG_S:  # NaN is in no range
        found = "nothing" if lag_s is None else repr(lag_s)
        raise PluginError(
            stage.label,
            f"it has smooth(), and lag_s is {found}",
            f"Set lag_s to a number of seconds from 0 to {MAX_SMOOTHING_LAG_S:g}.",
        )
    return round(float(lag_s) * 1e9 / TICK_NS)


def checked_motion(motion: Any) -> Motion:
    """Return ``motion`` if it is one and all its numbers are finite."""
    if not isinstance(motion, Motion):
        raise TypeError(f"returned {type(motion).__name__}, expected (state, Motion)")
    for name in _MOTION_NUMBERS:
        value = getattr(motion, name)
        if value is not None and not math.isfinite(value):
            raise FloatingPointError(f"returned Motion with {name} = {value}")
    if motion.distance_m < 0:
        raise ValueError(f"returned Motion with distance_m = {motion.distance_m}, must be ≥ 0")
    return motion


def checked_observation(observation: Any) -> Observation:
    """Return ``observation`` if it is one and its fix, if any, is finite with a positive covariance."""
    if not isinstance(observation, Observation):
        raise TypeError(f"returned {type(observation).__name__}, expected (state, Observation)")
    fix = observation.fix
    if fix is not None:
        if not isinstance(fix.t_ns, int | np.integer):
            raise TypeError(f"returned a fix with t_ns of type {type(fix.t_ns).__name__}, expected int")
        _check_floor(fix.floor)
        if not (np.isfinite(fix.xy).all() and np.isfinite(fix.covariance).all()):
            raise FloatingPointError("returned a fix that is not finite")
        (a, b), (c, d) = fix.covariance.tolist()
        if a <= 0 or d <= 0 or a * d - b * c <= 0:
            raise ValueError("returned a fix whose covariance is not positive definite")
    return observation


def checked_report(report: Any) -> Report:
    """Return ``report`` if it is one; numbers that are not finite are left out of it."""
    if not isinstance(report, Report):
        raise TypeError(f"returned {type(report).__name__}, expected (state, Report)")
    if not isinstance(report.reasons, tuple) or not all(isinstance(reason, str) for reason in report.reasons):
        raise TypeError("returned a Report with reasons that are no tuple of strings")
    if sum(map(len, report.reasons)) > _MAX_REASONS_CHARS or len(report.reasons) > _MAX_REASONS:
        raise ValueError(
            f"returned a Report with over {_MAX_REASONS} reasons, or {_MAX_REASONS_CHARS} characters of them"
        )
    for name, kinds in _REPORT_TYPES.items():
        if not isinstance(getattr(report, name), kinds):
            raise TypeError(f"returned a Report with {name} of type {type(getattr(report, name)).__name__}")
    changes: dict[str, Any] = {
        name: None
        for name in ("innovation_m", "nis")
        if getattr(report, name) is not None and not math.isfinite(getattr(report, name))
    }
    if report.diagnostics:
        changes["diagnostics"] = _checked_diagnostics(report.diagnostics)
    return dataclasses.replace(report, **changes) if changes else report


def _checked_diagnostics(diagnostics: Any) -> Mapping[str, float]:
    """Return a read-only copy with names in order and values as float, without those that are not finite."""
    if not isinstance(diagnostics, Mapping):
        raise TypeError(f"returned a Report with diagnostics of type {type(diagnostics).__name__}, expected a mapping")
    if len(diagnostics) > _MAX_DIAGNOSTICS:
        raise ValueError(f"returned a Report with {len(diagnostics)} diagnostics, at most {_MAX_DIAGNOSTICS} allowed")
    checked: dict[str, float] = {}
    for name, value in diagnostics.items():
        if not isinstance(name, str) or not _DIAGNOSTIC_NAME.fullmatch(name):
            raise ValueError(f"returned a Report with a diagnostic named {name!r:.80}, expected snake_case")
        number = float(value)
        if math.isfinite(number):
            checked[name] = number
    return MappingProxyType(dict(sorted(checked.items())))


def checked_belief(belief: Any, method: str = "estimate") -> Belief:
    """Return ``belief``, which ``method`` returned, if it is one, finite, with covariances that are."""
    if not isinstance(belief, Belief):
        raise TypeError(f"{method} returned {type(belief).__name__}, expected Belief")
    if len(belief.mixture) > _MAX_COMPONENTS or len(belief.floor_probabilities) > _MAX_COMPONENTS:
        raise ValueError(f"{method} returned a mixture or floors of over {_MAX_COMPONENTS} parts")
    _check_gaussian(belief, method)
    for component in belief.mixture:
        _check_gaussian(component, method)
    for floor, _ in belief.floor_probabilities:
        _check_floor(floor)
    numbers = [p for _, p in belief.floor_probabilities] + [c.weight for c in belief.mixture]
    numbers += [n for n in (belief.speed_mps, belief.heading_rad) if n is not None]
    if not all(map(math.isfinite, numbers)):
        raise FloatingPointError(f"{method} returned a speed, heading or probability that is not finite")
    return belief


def _check_floor(floor: Any) -> None:
    if not isinstance(floor, str):
        raise TypeError(f"returned a floor of type {type(floor).__name__}, expected its name")


def _check_gaussian(gaussian: Belief | Component, method: str) -> None:
    _check_floor(gaussian.floor)
    (x, y), ((a, b), (c, d)) = gaussian.xy.tolist(), gaussian.covariance.tolist()
    if not all(map(math.isfinite, (x, y, a, b, c, d))):
        raise FloatingPointError(f"{method} returned a belief that is not finite")
    # Rounding may leave an ellipse without width a little less than that.
    if a < 0 or d < 0 or abs(b - c) > 1e-6 * (1.0 + abs(b)) or a * d - b * c < -1e-9 * (1.0 + a * d):
        raise ValueError(f"{method} returned a covariance that is not symmetric and positive semi-definite")


def has_nan(state: Any) -> bool:
    """Tell whether an array or number within ``state`` is NaN."""
    todo = [state]
    for value in todo:  # which grows meanwhile
        kind = value.__class__
        if kind in _TYPES_WITHOUT_NAN:
            continue
        if kind is tuple:
            todo += value
        elif isinstance(value, float):
            if value != value:  # noqa: PLR0124 - only NaN differs from itself
                return True
        elif isinstance(value, np.ndarray):
            # A sum of squares is NaN where one of them is, and nowhere else: infinities only add up.
            if value.dtype.kind == "f" and math.isnan(np.vdot(value, value)):
                return True
        elif (within := field_values_getter(kind)) is not None:
            todo += within(value)
        elif isinstance(value, tuple):
            todo += value
    return False


MAX_SMOOTHING_LAG_S: Final = 60.0
"""The longest ``lag_s`` of a filter that smooths: states of all its ticks are kept for every device."""
_TYPES_WITHOUT_NAN: Final = frozenset({int, str, bool, bytes, type(None)})
_MAX_REASONS: Final = 64
_MAX_DIAGNOSTICS: Final = 64
_DIAGNOSTIC_NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,63}")
_MAX_REASONS_CHARS: Final = 4_096
_MAX_COMPONENTS: Final = 1_024
_REPORT_TYPES: Final = {"used": int | np.integer, "gated": int | np.integer, "lost": bool | np.bool_}
_MOTION_NUMBERS: Final = tuple(f.name for f in dataclasses.fields(Motion) if f.name not in ("steps", "stationary"))
