"""Gross errors of [wang2015] section 6.2, put between an algorithm and those who listen to it (Tables 5 and 7)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from tickfix.api import Motion, MotionSamples, Observation, Readings, Window
from tickfix.kernel import Pipeline, Stage
from tickfix.reproduction.wang2015.walks import FIX_S

EPOCHS_S: Final = (40.0, 60.0, 80.0)
"""Since the walk began."""
WIFI_M: Final[Mapping[float, tuple[float, float]]] = dict(
    zip(EPOCHS_S, ((10.0, 0.0), (10.0, 0.0), (0.0, 10.0)), strict=True)
)
"""Table 5: x and y by epoch."""
ODOMETRY_M: Final[Mapping[float, float]] = dict.fromkeys(EPOCHS_S, 10.0)
"""Table 7: s by epoch."""


@dataclass(frozen=True, slots=True, eq=False)
class DisturbedFingerprint:
    """A fingerprint whose fixes of some epochs are off; an epoch holds the scans of the two seconds that end with it.

    Attributes:
        inner: the fingerprint as it was built.
        errors_m: (x, y) by the epoch's time, ns.
    """

    inner: Any
    errors_m: Mapping[int, tuple[float, float]]

    @property
    def State(self) -> type[Any]:  # noqa: N802 - as algorithms name it
        """The state's type."""
        state: type[Any] = self.inner.State
        return state

    @property
    def window(self) -> Window:
        """Which readings it wants to see."""
        window: Window = self.inner.window
        return window

    def start(self) -> Any:
        """Return the state before any scan."""
        return self.inner.start()

    def step(self, state: Any, window: Readings) -> tuple[Any, Observation]:
        """Locate the window, and move what was found."""
        state, observation = self.inner.step(state, window)
        for t_ns, error_m in self.errors_m.items():
            if observation.fix is not None and 0 <= t_ns - window.t_ns < round(FIX_S * 1e9):
                fix = replace(observation.fix, xy=observation.fix.xy + np.array(error_m))
                observation = Observation(t_ns=observation.t_ns, source=observation.source, fix=fix)
        return state, observation


@dataclass(frozen=True, slots=True, eq=False)
class DisturbedOdometry:
    """A pseudo-odometry whose increments of some epochs are too long.

    Attributes:
        inner: the dead reckoning as it was built; it is read at multiples of two seconds.
        errors_m: by the epoch's time, ns.
    """

    inner: Any
    errors_m: Mapping[int, float]

    @property
    def State(self) -> type[Any]:  # noqa: N802 - as algorithms name it
        """The state's type."""
        state: type[Any] = self.inner.State
        return state

    def start(self) -> Any:
        """Return the state before any sample."""
        return self.inner.start()

    def step(self, state: Any, samples: MotionSamples) -> tuple[Any, Motion]:
        """Fold a tick's samples, and lengthen the way where an odometer is read wrongly."""
        state, motion = self.inner.step(state, samples)
        before_m = sum(error_m for t_ns, error_m in self.errors_m.items() if t_ns <= samples.t1_ns)
        return state, replace(
            motion,
            distance_m=motion.distance_m + self.errors_m.get(samples.t1_ns, 0.0),
            travelled_m=motion.travelled_m + before_m,
        )


def on_wifi(pipeline: Pipeline, begin_ns: int) -> Pipeline:
    """Return the pipeline with the gross errors of Table 5 on its fixes, for a walk that began at ``begin_ns``."""
    stage = pipeline.fingerprint
    assert stage is not None  # noqa: S101 - every scheme that is disturbed has one
    errors_m = {begin_ns + round(t_s * 1e9): error_m for t_s, error_m in WIFI_M.items()}
    return replace(
        pipeline,
        name=f"{pipeline.name}{ON_WIFI}",
        fingerprint=_instead(stage, DisturbedFingerprint(stage.algorithm, errors_m)),
    )


def on_odometry(pipeline: Pipeline, begin_ns: int) -> Pipeline:
    """Return the pipeline with the gross errors of Table 7 on its increments, for a walk that began at ``begin_ns``."""
    stage = pipeline.pdr
    assert stage is not None  # noqa: S101 - every scheme that is disturbed has one
    errors_m = {begin_ns + round(t_s * 1e9): error_m for t_s, error_m in ODOMETRY_M.items()}
    return replace(
        pipeline,
        name=f"{pipeline.name}{ON_ODOMETRY}",
        pdr=_instead(stage, DisturbedOdometry(stage.algorithm, errors_m)),
    )


ON_WIFI: Final = ", errors on Wi-Fi"
ON_ODOMETRY: Final = ", errors on P-O"


def _instead(stage: Stage, algorithm: Any) -> Stage:
    return replace(stage, key=f"{stage.key} with gross errors", algorithm=algorithm)
