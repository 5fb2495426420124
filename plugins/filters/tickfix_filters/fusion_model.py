"""The models of ``fusion-pf``.

Parameters and the preset of [jiang2015], state, motion model, map and wall-alignment weights, and the estimate computed
from the particles. A tick's displacement has a length and a direction and errs in both, [jiang2015] eq. (16); the
isotropic diffusion on top is drawn along and across it, so every particle takes four random numbers. All functions work
on D devices with N particles each; the filter itself is :mod:`tickfix_filters.fusion_pf`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Annotated, Final, Literal

import numpy as np

from tickfix.api import Belief, Fix, Floats, FloorMap, Motion, Preset, Rng, frozen, parameter, wrap_rad
from tickfix.toolkit.fix_errors import FixErrorParams, FloorHysteresis, sigma_per_axis_m
from tickfix.toolkit.particles import normal_pairs, normalise_log_weights, spatial_median, weighted_mean
from tickfix.toolkit.walkable_area import WallDirections


@dataclass(frozen=True)
class FusionPfParams(FixErrorParams):
    """Parameters of ``fusion-pf``."""

    particles: Annotated[int, parameter("N, which is not printed", source="[jiang2015] section 6", ge=2)] = 500
    diffusion_m: Annotated[
        float,
        parameter(
            "way per square root of a second that no step explains; Q",
            unit="m/√s",
            source="[jiang2015] eq. (16)",
            ge=0,
        ),
    ] = 0.1
    use_motion_noise: Annotated[
        bool,
        parameter("particles move with the errors that motion reports; else all alike, eq. (16)", formerly="own_ways"),
    ] = True
    fix_sigma_m: Annotated[
        float,
        parameter(
            "σ of an observed place, per axis; 0: the covariance of the fix",
            unit="m",
            source="[jiang2015] eq. (18)",
            ge=0,
        ),
    ] = 0.0
    weight_without_fix: Annotated[
        Literal["nothing", "motion"],
        parameter(
            "what weighs particles in a tick without a fix: motion, the place it leads to; or nothing",
            formerly="without_fix",
        ),
    ] = "nothing"
    resampling: Annotated[
        Literal["systematic", "multinomial"], parameter("how particles are drawn; multinomial: with replacement, SIR")
    ] = "systematic"
    crossing_weight: Annotated[
        float, parameter("share of its weight a particle keeps when it crosses a wall", gt=0, le=1)
    ] = 0.2
    outside_weight: Annotated[
        float, parameter("share of its weight it keeps with each step outside the walkable area", gt=0, le=1)
    ] = 0.5
    wall_alignment: Annotated[
        float,
        parameter(
            "share of ways that run along the nearest wall or perpendicular to it; 0: directions carry no information",
            source="[borenstein2010]",
            ge=0,
            lt=1,
            formerly="aligned",
        ),
    ] = 0.6
    alignment_sigma_rad: Annotated[
        float,
        parameter(
            "σ of their direction", unit="rad", source="[borenstein2010]", ge=0.05, le=0.5, formerly="aligned_sigma_rad"
        ),
    ] = 0.15
    alignment_length_m: Annotated[
        float,
        parameter(
            "a way this long is one piece of evidence: shorter ones repeat it", unit="m", gt=0, formerly="aligned_m"
        ),
    ] = 12.0
    injection_rate: Annotated[
        float,
        parameter(
            "share of the particles that are reinitialised at a good fix",
            source="[lenser2000]",
            ge=0,
            lt=1,
            formerly="renewed",
        ),
    ] = 0.03
    injection_rate_lost: Annotated[
        float,
        parameter("the same while fixes and particles contradict each other", ge=0, lt=1, formerly="renewed_lost"),
    ] = 0.25
    injection_sigma_m: Annotated[
        float,
        parameter(
            "a fix with this σ is good; at a poorer one fewer are reinitialised",
            unit="m",
            gt=0,
            formerly="renewed_sigma_m",
        ),
    ] = 4.0
    initial_sigma_m: Annotated[
        float,
        parameter(
            "particles begin within no more than this σ around a fix, however poor",
            unit="m",
            gt=0,
            formerly="scatter_m",
        ),
    ] = 12.0
    reference_sigma_m: Annotated[
        float,
        parameter(
            "fixes have this σ where a survey came; poorer ones let walls, and their own distance, count for less",
            unit="m",
            gt=0,
            formerly="surveyed_m",
        ),
    ] = 5.0
    reset_distance_m: Annotated[
        float,
        parameter(
            "all particles are reinitialised once fixes lie this far off their mean, in one direction, for some scans",
            unit="m",
            gt=0,
            formerly="astray_m",
        ),
    ] = 15.0
    ess_threshold: Annotated[
        float,
        parameter("effective share of particles that calls for resampling", gt=0, le=1, formerly="resample_below"),
    ] = 0.5
    point_estimate: Annotated[
        Literal["median", "mean"],
        parameter(
            "the position estimate: spatial median (least mean error) or mean (least mean square error)",
            formerly="centre",
        ),
    ] = "median"

    def __post_init__(self) -> None:
        """Check what belongs together.

        Raises:
            ValueError: when motion is to weigh particles, but not how sharply.
        """
        if self.weight_without_fix == "motion" and self.fix_sigma_m == 0.0:
            raise ValueError('fix_sigma_m: found 0 with without_fix = "motion", expected > 0: σ of eq. (18)')


JIANG2015: Final = Preset(
    "[jiang2015] sections 6–7, eqs. (14)–(19): SIR, by the fix where there is one, else by the motion result; knows no "
    "walls. σ is 50 without unit there, 50 cm is taken; Q is a variance of 0.1 m/s² there, 0.1 m² a tick is taken",
    {
        "diffusion_m": math.sqrt(0.1 / 0.2),  # 0.1 m² in 0.2 s
        "use_motion_noise": False,
        "fix_sigma_m": 0.5,
        "weight_without_fix": "motion",
        "resampling": "multinomial",
        "error_correlation": 0.0,
        "student_t_dof": 1e12,  # Student's t is Gaussian then
        "crossing_weight": 1.0,
        "outside_weight": 1.0,
        "wall_alignment": 0.0,
        "injection_rate": 0.0,
        "injection_rate_lost": 0.0,
        "initial_sigma_m": 1e6,
        "reset_distance_m": 1e6,
        "ess_threshold": 1.0,
        "point_estimate": "mean",
    },
)


@dataclass(frozen=True, slots=True)
class BiasPrior:
    """Standard deviations of the biases that motion reported, and whether there is a compass."""

    heading_rad: float
    scale: float
    compass: bool


@dataclass(frozen=True, slots=True)
class DriftSinceFix:
    """How unsure a walk since the last fix is, where particles that are weighed by it do not spread.

    Attributes:
        walked_m: since then; with ``bias``, the relative error that a walk keeps, how far it may have led astray.
        white_m2: variance of the ticks' ways.
    """

    walked_m: float = 0.0
    bias: float = 0.0
    white_m2: float = 0.0

    def with_motion(self, motion: Motion) -> DriftSinceFix:
        """Return it after a tick."""
        white_m2 = motion.distance_sigma_m**2 + (motion.distance_m * min(motion.heading_sigma_rad, 1.0)) ** 2
        bias = math.hypot(motion.distance_scale_sigma, min(motion.heading_bias_sigma_rad, 1.0))
        return DriftSinceFix(self.walked_m + motion.distance_m, bias, self.white_m2 + white_m2)

    @property
    def variance_m2(self) -> float:
        """Per axis."""
        return 0.5 * (self.white_m2 + (self.bias * self.walked_m) ** 2)


@dataclass(frozen=True, slots=True)
class Particles:
    """N particles.

    Attributes:
        hysteresis: the floor all are on.
        xy: (N, 2) metres.
        bias_rad, scale: (N,) of the heading, and of the length of steps.
        error: (N, 2) of the last fix in multiples of its σ, if the particle is right.
        log_weights: (N,).
        mean_nis: running mean of the squared distance between fixes and particles' mean, in σ² per axis; about one when
            all is well.
        mean_fix_offset: (2,) metres, running mean of the way from the particles' mean to the fixes.
        fix_quality: in (0, 1], reference_sigma_m / σ of the last fix; low outside the survey.
        motion: the biases that motion reported, None before the first.
        drift_since_fix: what weighing by the motion result hides.
    """

    hysteresis: FloorHysteresis
    xy: Floats
    bias_rad: Floats
    scale: Floats
    error: Floats
    log_weights: Floats
    last_fix_ns: int
    mean_fix_offset: Floats
    heading_rad: float | None = None
    speed_mps: float = 0.0
    mean_nis: float = 1.0
    fix_quality: float = 1.0
    motion: BiasPrior | None = None
    drift_since_fix: DriftSinceFix = DriftSinceFix()


_MAX_PARTICLES_PER_BATCH: Final = 16384  # particles in a batch: their arrays stay in the processor's cache


def batches(states: Sequence[Particles]) -> Iterator[slice]:
    """Cut the states of many devices into runs that can be computed together: as many particles each, and not too many.

    How they are cut changes no bits.
    """
    begin = 0
    for n, run in groupby(states, lambda state: len(state.xy)):
        end = begin + len(list(run))
        at_once = max(1, _MAX_PARTICLES_PER_BATCH // n)
        for first in range(begin, end, at_once):
            yield slice(first, min(first + at_once, end))
        begin = end


def initial_bias_prior(motion: Motion, params: FusionPfParams) -> BiasPrior:
    """Return the prior of the biases from the first ``motion``; None where all particles move alike."""
    if not params.use_motion_noise:
        return BiasPrior(0.0, 0.0, compass=True)
    compass = motion.heading_rad is not None
    return BiasPrior(motion.heading_bias_sigma_rad, motion.distance_scale_sigma, compass=compass)


def sample_biases(prior: BiasPrior, n: int, rng: Rng) -> tuple[Floats, Floats]:
    """Draw biases (n,) of the heading and of the length of steps."""
    bias = prior.heading_rad * rng.standard_normal(n) if prior.compass else rng.uniform(-math.pi, math.pi, n)
    return bias, prior.scale * rng.standard_normal(n)


def heading_rad(state: Particles, motion: Motion) -> float:
    """Return the heading of a tick, before biases.

    Without compass the biases begin all around, and turns are all there is to follow.
    """
    if motion.heading_rad is not None:
        return motion.heading_rad
    return float(wrap_rad((state.heading_rad or 0.0) + motion.turn_rad))


def propagate(
    xy: Floats,
    bias_rad: Floats,
    scale: Floats,
    headings_rad: Sequence[float],
    motions: Sequence[Motion],
    rngs: Sequence[Rng],
    params: FusionPfParams,
) -> tuple[Floats, Floats]:
    """Return where the particles of D devices walk, (D, N, 2) metres, and the biases of their headings then, (D, N).

    Args:
        xy: (D, N, 2) metres.
        bias_rad, scale: (D, N).
        headings_rad, motions, rngs: of each device.
        params: of the filter.
    """
    noise_scale = float(params.use_motion_noise)
    table = [
        (
            heading,
            motion.distance_m,
            params.diffusion_m * math.sqrt((motion.t1_ns - motion.t0_ns) * 1e-9),
            noise_scale * motion.distance_sigma_m,
            noise_scale * motion.heading_sigma_rad,
            noise_scale * motion.turn_bias_sigma_rad,
        )
        for heading, motion in zip(headings_rad, motions, strict=True)
    ]
    # The way is computed in single precision, a ten-millionth of it; the place it leads to is not.
    columns = np.array(table, dtype=np.float32).T[:, :, None]
    heading, distance, diffusion, distance_sigma, heading_sigma, turn_bias_sigma = columns
    n = xy.shape[1]
    normal_a, normal_b = normal_pairs(rngs, 2 * n)
    bias = bias_rad + turn_bias_sigma * normal_a[:, :n]
    theta = heading + bias.astype(np.float32) + heading_sigma * normal_a[:, n:]
    along = distance * (1.0 + scale.astype(np.float32)) + np.hypot(diffusion, distance_sigma) * normal_b[:, :n]
    across = diffusion * normal_b[:, n:]
    sine, cosine = np.sin(theta), np.cos(theta)
    propagated = np.empty_like(xy)
    propagated[..., 0] = xy[..., 0] + (along * sine + across * cosine)
    propagated[..., 1] = xy[..., 1] + (along * cosine - across * sine)
    return propagated, bias


_CANDIDATES_PER_PARTICLE: Final = 8  # places drawn for each particle, to find one where it can stand


def sample_around_fix(fix: Fix, n: int, floor_map: FloorMap | None, params: FusionPfParams, rng: Rng) -> Floats:
    """Draw n places (n, 2) around the fix, those preferred where one can stand."""
    drawn = n if floor_map is None else _CANDIDATES_PER_PARTICLE * n
    xy = fix.xy + min(sigma_per_axis_m(fix), params.initial_sigma_m) * rng.standard_normal((drawn, 2))
    if floor_map is None:
        return xy
    free = xy[floor_map.contains(xy)]
    return free[np.arange(n) % len(free)] if len(free) else floor_map.nearest_free(xy[:n])


def wall_log_weight(
    before: Floats,
    after: Floats,
    floors: Sequence[str],
    motions: Sequence[Motion],
    maps: Mapping[str, FloorMap],
    params: FusionPfParams,
) -> Floats:
    """Return the logarithm (D, N) of the share of its weight that a map leaves to each particle; 0 without a map.

    Args:
        before, after: (D, N, 2) metres, the ends of the particles' ways.
        floors, motions: of each device.
        maps: by floor; each is called once for all devices on its floor.
        params: of the filter.
    """
    log_share = np.zeros(after.shape[:2])
    for floor in dict.fromkeys(floors):
        if (floor_map := maps.get(floor)) is None:
            continue
        here = np.flatnonzero([each == floor for each in floors])
        crossed = floor_map.crosses(before[here].reshape(-1, 2), after[here].reshape(-1, 2)).reshape(len(here), -1)
        log_share[here] = math.log(params.crossing_weight) * crossed
        steps = np.array([motions[d].steps for d in here.tolist()])
        here, steps = here[steps > 0], steps[steps > 0]
        if len(here):
            outside = ~floor_map.contains(after[here].reshape(-1, 2)).reshape(len(here), -1)
            log_share[here] += steps[:, None] * math.log(params.outside_weight) * outside
    return log_share


def wall_alignment(
    theta_rad: Floats,
    xy: Floats,
    floors: Sequence[str],
    motions: Sequence[Motion],
    directions: Mapping[str, WallDirections],
    params: FusionPfParams,
) -> Floats:
    """Return the logarithm (D, N) of how much more likely ways are that run as walls do, than ways of any direction.

    With the share q of ways that run along or across the nearest wall, δ off it (von Mises, σ), and the d metres of
    this tick,

        log w = d/L · log(1 − q + q · exp(κ cos 4δ) / I₀(κ)),    κ = 1/(4σ)².

    Args:
        theta_rad: (D, N), where the particles head.
        xy: (D, N, 2) metres, where they are.
        floors, motions: of each device.
        directions: by floor.
        params: of the filter.
    """
    log_weights = np.zeros(theta_rad.shape)
    q, kappa = params.wall_alignment, 0.0625 / params.alignment_sigma_rad**2
    peak = q / float(np.i0(kappa))
    for floor in dict.fromkeys(floors):
        if (walls := directions.get(floor)) is None:
            continue
        here = [d for d, each in enumerate(floors) if each == floor and motions[d].distance_m > 0.0]
        if here:
            off = theta_rad[here].astype(np.float32) - walls.nearest_wall_heading_rad(xy[here])
            share = np.log((1.0 - q) + peak * np.exp(kappa * np.cos(4.0 * off)))
            metres = np.array([[motions[d].distance_m] for d in here])
            log_weights[here] = metres / params.alignment_length_m * np.nan_to_num(share)
    return log_weights


def mean_xy(state: Particles) -> Floats:
    """Return the weighted mean (2,) of the particles' places."""
    weights = normalise_log_weights(state.log_weights)
    return np.array([weighted_mean(weights, state.xy[:, 0]), weighted_mean(weights, state.xy[:, 1])])


def beliefs_of_particles(states: Sequence[Particles], *, median: bool) -> list[Belief]:
    """Return what each of D states with N particles means, around their spatial median or their mean."""
    weights = normalise_log_weights(np.array([state.log_weights for state in states]))
    xy = np.array([state.xy for state in states])
    mean_x, mean_y = weighted_mean(weights, xy[..., 0]), weighted_mean(weights, xy[..., 1])
    x, y = xy[..., 0] - mean_x[:, None], xy[..., 1] - mean_y[:, None]
    off_x, off_y = spatial_median(x, y, weights) if median else (np.zeros(len(states)), np.zeros(len(states)))
    centres = frozen(np.array([mean_x + off_x, mean_y + off_y]).T)
    drift_since_fix = np.array([state.drift_since_fix.variance_m2 for state in states])
    wx = weights * x
    xx = weighted_mean(wx, x) + off_x * off_x + drift_since_fix
    xy_ = weighted_mean(wx, y) + off_x * off_y
    yy = weighted_mean(weights * y, y) + off_y * off_y + drift_since_fix
    covariances = frozen(np.array([[xx, xy_], [xy_, yy]]).T)
    mean_bias_rad = _circular_means(weights, np.array([state.bias_rad for state in states]))
    return [
        Belief(
            floor=state.hysteresis.floor,
            xy=centres[d],
            covariance=covariances[d],
            speed_mps=state.speed_mps,
            heading_rad=None if state.heading_rad is None else float(wrap_rad(state.heading_rad + mean_bias_rad[d])),
        )
        for d, state in enumerate(states)
    ]


def _circular_means(weights: Floats, angles: Floats) -> list[float]:
    """Return the direction in which each row of angles (D, N) points on the whole."""
    single, w = angles.astype(np.float32), weights.astype(np.float32)
    sine, cosine = np.add.reduce(np.sin(single) * w, axis=-1), np.add.reduce(np.cos(single) * w, axis=-1)
    return [math.atan2(*pair) for pair in zip(sine.tolist(), cosine.tolist(), strict=True)]
