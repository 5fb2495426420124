"""One seed of [wang2015].

The schemes as pipelines, gross errors put between algorithm and filter (Tables 5 and 7), and every scheme's error at
every epoch.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from tickfix.api import TICK_NS, Estimate, Floats, Motion, MotionSamples, Observation, Readings, SiteError, Window
from tickfix.config import Pipeline, Registry, Stage, parse_config
from tickfix.evaluation import prepare
from tickfix.replay import replay_recording, start_at_first_waypoint, train, trainable_choices
from tickfix.site import Site
from tickfix_papers.wang2015.twin import FIX_S, Twin, draw_twin

GCK: Final = "GCK"
PDR: Final = "PDR"
WPO: Final = "WPO"
MWPO: Final = "MWPO"
SCHEMES: Final = (GCK, PDR, WPO, MWPO)
NO_MAP: Final = "MWPO, no map"
EKF_MOTION: Final = "MWPO, EKF motion"
"""The other reading of section 5: particles walk by the EKF's velocity, so that P-O reaches them only through it."""
REJECTING: Final = ", dropping"
"""The other reading of eq. (22): what fails the δS test is not input at all."""

UNMAPPED_PARTICLES: Final = (100, 200, 300, 400, 500)
"""Table 1."""
MAPPED_PARTICLES: Final = (40, 50, 60, 70, 80)
"""Table 2."""
PARTICLES: Final = (*MAPPED_PARTICLES, *UNMAPPED_PARTICLES)

DISTURBED: Final = (WPO, MWPO, WPO + REJECTING, MWPO + REJECTING, EKF_MOTION, NO_MAP)
"""The schemes that gross errors are put into."""

_ODOMETRY: Final = 'pdr = { use = "pseudo-odometry", preset = "wang2015" }\n'
_MAP: Final = 'map = "regions"\n'


def particle_scheme(particles: int, *, mapped: bool) -> str:
    """Return the name of the filter of this size."""
    return f"{particles} particles {'with' if mapped else 'without'} map"


def pdr_configuration() -> str:
    """Return the configuration of scheme 2, which starts at a known place."""
    return f'[pipelines."{PDR}"]\n{_ODOMETRY}filter = "dead-reckoning"\n'


def wifi_configuration(sigma_m: float | None = None) -> str:
    """Return the configuration of scheme 1; ``sigma_per_axis_m`` is the noise of its fixes per axis, where that is
    known.
    """
    return f'[pipelines."{GCK}"]\n{_fingerprint_line(sigma_m)}filter = "fixes"\n'


def fused_configuration(sigma_m: float) -> str:
    """Return the configuration of all schemes that start at their first fix, whose noise per axis is
    ``sigma_per_axis_m``.
    """
    given = _ODOMETRY + _fingerprint_line(sigma_m)

    def pipeline(name: str, use: str) -> str:
        return f'[pipelines."{name}"]\n{given}filter = {use}\n'

    parts = [
        wifi_configuration(sigma_m),
        pipeline(WPO, '{ use = "fading-ekf", preset = "wang2015" }'),
        pipeline(WPO + REJECTING, '{ use = "fading-ekf", preset = "wang2015-reject" }'),
        pipeline(MWPO, '{ use = "map-pf", preset = "wang2015" }') + _MAP,
        pipeline(MWPO + REJECTING, '{ use = "map-pf", preset = "wang2015", reject_go_and_back = true }') + _MAP,
        pipeline(EKF_MOTION, '{ use = "map-pf", preset = "wang2015-ekf" }') + _MAP,
        pipeline(NO_MAP, '{ use = "map-pf", preset = "wang2015" }'),
    ]
    for particles in PARTICLES:
        use = f'{{ use = "map-pf", preset = "wang2015", particles = {particles} }}'
        parts.append(pipeline(particle_scheme(particles, mapped=False), use))
        parts.append(pipeline(particle_scheme(particles, mapped=True), use) + _MAP)
    return "\n".join(parts)


def _fingerprint_line(sigma_m: float | None) -> str:
    noise = "" if sigma_m is None else f", sigma_m = {sigma_m!r}"
    return f'fingerprint = {{ use = "topology-knn", preset = "wang2015"{noise} }}\n'


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


def with_wifi_errors(pipeline: Pipeline, begin_ns: int) -> Pipeline:
    """Return the pipeline with the gross errors of Table 5 on its fixes, for a walk that began at ``begin_ns``."""
    stage = pipeline.fingerprint
    assert stage is not None  # noqa: S101 - every scheme that is disturbed has one
    errors_m = {begin_ns + round(t_s * 1e9): error_m for t_s, error_m in WIFI_M.items()}
    return replace(
        pipeline,
        name=f"{pipeline.name}{ON_WIFI}",
        fingerprint=_with_algorithm(stage, DisturbedFingerprint(stage.algorithm, errors_m)),
    )


def with_odometry_errors(pipeline: Pipeline, begin_ns: int) -> Pipeline:
    """Return the pipeline with the gross errors of Table 7 on its increments, for a walk that began at ``begin_ns``."""
    stage = pipeline.pdr
    assert stage is not None  # noqa: S101 - every scheme that is disturbed has one
    errors_m = {begin_ns + round(t_s * 1e9): error_m for t_s, error_m in ODOMETRY_M.items()}
    return replace(
        pipeline,
        name=f"{pipeline.name}{ON_ODOMETRY}",
        pdr=_with_algorithm(stage, DisturbedOdometry(stage.algorithm, errors_m)),
    )


ON_WIFI: Final = ", errors on Wi-Fi"
ON_ODOMETRY: Final = ", errors on P-O"


def _with_algorithm(stage: Stage, algorithm: Any) -> Stage:
    return replace(stage, key=f"{stage.key} with gross errors", algorithm=algorithm)


_FIRST_EPOCH = 2
"""A matrix of two measurements takes two epochs."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SeedRun:
    """What the schemes made of one walk, at its n epochs.

    Attributes:
        seed: of the twin.
        t_s: (n,) since the walk began, every 2 s.
        truth: (n, 2) metres.
        xy: by scheme, the places published (n, 2), metres.
        failures: stage calls that failed.
    """

    seed: int
    t_s: Floats
    truth: Floats
    xy: Mapping[str, Floats]
    failures: Mapping[str, int]

    def error_m(self, scheme: str) -> Floats:
        """Return how far a scheme was off at each epoch, (n,) metres."""
        errors: Floats = np.hypot(*(self.xy[scheme] - self.truth).T)
        return errors

    def residual_m(self, scheme: str, t_s: float) -> float:
        """Return how far a scheme was off at the epoch of ``t_s``, metres."""
        return float(self.error_m(scheme)[int(np.argmin(np.abs(self.t_s - t_s)))])


def run_seed(registry: Registry, seed: int) -> SeedRun:
    """Draw the twin of a seed and let every scheme follow the test walk.

    Raises:
        SiteError: when an algorithm cannot be trained.
        TickfixError: when one cannot be built.
    """
    twin = draw_twin(seed)
    sigma_m = calibrated_sigma_m(twin, registry)
    schemes, pdr_only = (
        parse_config(text, "wang2015", registry) for text in (fused_configuration(sigma_m), pdr_configuration())
    )
    choices = [
        choice for choice in trainable_choices((*schemes.pipelines, *pdr_only.pipelines)) if choice.offer.kind == "pdr"
    ]
    models, problems = train(choices, twin.survey, seed)
    if problems:
        raise SiteError(f"wang2015: {'; '.join(problems)}")
    site = replace(_surveyed_site(twin), models=models)
    begin_ns = int(twin.walk.t_ns[0])
    setup = prepare(site, schemes)
    by_name = {pipeline.name: pipeline for pipeline in setup.pipelines}
    disturbed = [
        disturb(by_name[name], begin_ns) for disturb in (with_wifi_errors, with_odometry_errors) for name in DISTURBED
    ]
    recording = twin.walk.recording
    followed = replay_recording(recording, (*setup.pipelines, *disturbed), setup.settings)
    reckoned = replay_recording(
        recording, prepare(site, pdr_only).pipelines, setup.settings, start=start_at_first_waypoint(recording)
    )
    published = {**followed.published, **reckoned.published}
    last = int((int(twin.walk.t_ns[-1]) - begin_ns) / (FIX_S * 1e9))
    t_s = FIX_S * np.arange(_FIRST_EPOCH, last + 1, dtype=np.float64)
    ticks = ((begin_ns + np.rint(t_s * 1e9).astype(np.int64)) // TICK_NS).tolist()
    return SeedRun(
        seed=seed,
        t_s=t_s,
        truth=twin.walk.trajectory.xy_at(t_s),
        xy={
            name: _positions_at_ticks([estimate for estimate, _ in timed_estimates], ticks)
            for name, timed_estimates in published.items()
        },
        failures={**followed.failures, **reckoned.failures},
    )


def calibrated_sigma_m(twin: Twin, registry: Registry) -> float:
    """Return σ per axis of the Wi-Fi positions of the calibration walks, metres."""
    pipelines = prepare(_surveyed_site(twin), parse_config(wifi_configuration(), "wang2015", registry)).pipelines
    squares = []
    for walk in twin.calibration:
        for fixes in replay_recording(walk.recording, pipelines).fixes.values():
            t_s = np.array([fix.t_ns - int(walk.t_ns[0]) for fix in fixes]) * 1e-9
            squares.append((np.array([fix.xy for fix in fixes]) - walk.trajectory.xy_at(t_s)) ** 2)
    return float(np.sqrt(np.concatenate(squares).mean()))


def _surveyed_site(twin: Twin) -> Site:
    return Site(name="wang2015", floors=twin.building.floors, radio_map=twin.radio_map)


def _positions_at_ticks(estimates: Sequence[Estimate], ticks: Sequence[int]) -> Floats:
    """Return the places (n, 2) of these ticks, NaN where a scheme had none."""
    places = {estimate.tick: estimate.belief.xy for estimate in estimates if estimate.belief is not None}
    return np.array([places.get(tick, np.full(2, np.nan)) for tick in ticks])
