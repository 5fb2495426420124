"""One seed of [jiang2015]'s experiments: train, track, and measure what its tables and figures show."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import Final

import numpy as np

from tickfix.api import TICK_NS, Estimate, Fix, Floats, Recording, Rng, Scan, SiteError, Survey, TrainedModel
from tickfix.config import Config, Pipeline, Registry, parse_config
from tickfix.evaluation import prepare
from tickfix.replay import ReplayResult, replay_recording, train, trainable_choices
from tickfix.simulation import SimulatedWalk
from tickfix.site import Site
from tickfix_papers.jiang2015.twin import draw_twin


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrackErrors:
    """A pipeline on a walk.

    Attributes:
        t_s: (n,) of its ticks with a position, since the walk began.
        xy: (n, 2) published, metres.
        error_m: (n,) distance from the true place at the tick.
        fix_error_m: (m,) the same, settled, at the ticks that brought a location result; empty without Wi-Fi.
        update_interval_s: mean time from one published position to the next other one.
    """

    t_s: Floats
    xy: Floats
    error_m: Floats
    fix_error_m: Floats
    update_interval_s: float

    @property
    def second_difference_m(self) -> float:
        """Mean length of the second difference of the positions, metres: 0 for a straight, steady track."""
        return float(np.hypot(*np.diff(self.xy, 2, axis=0).T).mean())

    @property
    def error_growth_m(self) -> float:
        """Mean error in the last quarter of the walk minus that in the second, metres."""
        quarters = np.array_split(self.error_m, 4)
        return float(quarters[3].mean() - quarters[1].mean())


def measure_track(pipeline: Pipeline, replayed: ReplayResult, walk: SimulatedWalk) -> TrackErrors:
    """Measure a pipeline on a walk."""
    t_s, xy, error_m = _position_errors(replayed.published[pipeline.name], walk)
    stage = pipeline.fingerprint
    ticks = set() if stage is None else {-(-fix.t_ns // TICK_NS) for fix in replayed.fixes[stage.key]}
    located = [(estimate, 0) for estimate in replayed.settled[pipeline.name] if estimate.tick in ticks]
    changes = t_s[1:][np.any(np.diff(xy, axis=0) != 0.0, axis=1)]
    return TrackErrors(
        t_s=t_s,
        xy=xy,
        error_m=error_m,
        fix_error_m=_position_errors(located, walk)[2],
        update_interval_s=float(np.diff(changes).mean()),
    )


def with_given_fixes(walk: SimulatedWalk, sigma_m: float, rng: Rng) -> Recording:
    """Return the recording with a fix in the place of each scan, off by ``sigma_per_axis_m`` in each coordinate."""

    def given(scan: Scan) -> Fix:
        xy = walk.trajectory.xy_at(np.array((scan.t_ns - walk.t_ns[0]) * 1e-9)) + sigma_m * rng.standard_normal(2)
        return Fix(
            t_ns=scan.t_ns,
            floor=walk.recording.floor,
            xy=xy,
            covariance=sigma_m**2 * np.eye(2),
            device=scan.device,
            arrival_ns=scan.arrival_ns,
            seq=scan.seq,
        )

    events = tuple(given(event) if isinstance(event, Scan) else event for event in walk.recording.events)
    return replace(walk.recording, events=events)


def _position_errors(
    timed_estimates: Iterable[tuple[Estimate, int]], walk: SimulatedWalk
) -> tuple[Floats, Floats, Floats]:
    """Return times (n,), places (n, 2) and errors (n,) of the estimates that have a belief."""
    known = [(estimate.t_ns, estimate.belief.xy) for estimate, _ in timed_estimates if estimate.belief is not None]
    t_s = (np.array([t_ns for t_ns, _ in known], np.int64) - walk.t_ns[0]) * 1e-9
    xy = np.array([xy for _, xy in known]).reshape(-1, 2)
    error_m: Floats = np.hypot(*(xy - walk.trajectory.xy_at(t_s)).T)
    return t_s, xy, error_m


GIVEN_SIGMA_M: Final = (0.1, 0.25, 0.5, 1.0, 2.0)
"""Errors of location results that are given, per coordinate."""
_START_SIGMA_M: Final = 0.1
_TRUTH_STRIDE: Final = 20
"""Of a true way, one instant in so many is kept for pictures: ten a second."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SeedRun:
    """The results of one seed.

    Attributes:
        window_mse: by window length in ms, (velocity in m²/s², heading in rad²).
        tracks: by pipeline, one for each walk.
        given: by error of the location results given (per coordinate, m) and pipeline, the mean error in metres.
        truth: of each walk, (n, 2) metres.
        failures: stage calls that failed.
    """

    window_mse: Mapping[int, tuple[float, float]]
    tracks: Mapping[str, tuple[TrackErrors, ...]]
    given: Mapping[float, Mapping[str, float]]
    truth: tuple[Floats, ...]
    failures: Mapping[str, int]

    def mean_error_m(self, pipeline: str) -> float:
        """Return the mean over all ticks of all walks."""
        return float(np.concatenate([track.error_m for track in self.tracks[pipeline]]).mean())

    def mean_fix_error_m(self, pipeline: str) -> float:
        """Return the mean over all location results of all walks."""
        return float(np.concatenate([track.fix_error_m for track in self.tracks[pipeline]]).mean())


def run_seed(registry: Registry, seed: int) -> SeedRun:
    """Run all experiments once.

    Raises:
        SiteError: when something cannot be trained.
    """
    scene = draw_twin(seed)
    config = _configuration("pipelines.toml", seed, registry)
    models = _train_models(config, scene.training_data, seed)
    site = Site(name="jiang2015", floors=(scene.floor,), radio_map=scene.training_data.radio_map, models=models)
    tracks: dict[str, list[TrackErrors]] = {pipeline.name: [] for pipeline in config.pipelines}
    failures: Counter[str] = Counter()
    # Motion needs a known start; Wi-Fi alone finds its own.
    for with_motion in (True, False):
        names = [p.name for p in config.pipelines if (p.pdr is not None) == with_motion]
        setup = prepare(site, config.only(names))
        for walk in scene.walks:
            start = _known_start(walk) if with_motion else None
            replayed = replay_recording(walk.recording, setup.pipelines, setup.settings, start=start)
            failures.update(replayed.failures)
            for pipeline in setup.pipelines:
                tracks[pipeline.name].append(measure_track(pipeline, replayed, walk))
    return SeedRun(
        window_mse=_window_mse(scene.training_data, seed, registry),
        tracks={name: tuple(found) for name, found in tracks.items()},
        given=_errors_by_fix_sigma(site, scene.walks, seed, registry),
        truth=tuple(walk.trajectory.xy[::_TRUTH_STRIDE] for walk in scene.walks),
        failures=dict(failures),
    )


def _window_mse(training_data: Survey, seed: int, registry: Registry) -> dict[int, tuple[float, float]]:
    config = _configuration("windows.toml", seed, registry)
    models = _train_models(config, training_data, seed)
    found = {}
    for pipeline in config.pipelines:
        if pipeline.pdr is not None:
            velocity, heading = np.asarray(models[pipeline.pdr.model]["window_mse"]).tolist()
            found[int(pipeline.name)] = (velocity, heading)
    return found


def _errors_by_fix_sigma(
    site: Site, walks: tuple[SimulatedWalk, ...], seed: int, registry: Registry
) -> dict[float, dict[str, float]]:
    setup = prepare(site, _configuration("given.toml", seed, registry))
    found = {}
    for sigma_m in GIVEN_SIGMA_M:
        errors: dict[str, list[Floats]] = {pipeline.name: [] for pipeline in setup.pipelines}
        for n, walk in enumerate(walks):
            recording = with_given_fixes(walk, sigma_m, np.random.default_rng([seed, n]))
            replayed = replay_recording(recording, setup.pipelines, setup.settings, start=_known_start(walk))
            for pipeline in setup.pipelines:
                errors[pipeline.name].append(measure_track(pipeline, replayed, walk).error_m)
        found[sigma_m] = {name: float(np.concatenate(each).mean()) for name, each in errors.items()}
    return found


def pipelines_in(file: str) -> str:
    """Return the text of one of this folder's configurations."""
    return files("tickfix_papers.jiang2015").joinpath(file).read_text("utf-8")


def _configuration(file: str, seed: int, registry: Registry) -> Config:
    config = parse_config(pipelines_in(file), file, registry)
    return replace(config, kernel=replace(config.kernel, seed=seed))


def _train_models(config: Config, training_data: Survey, seed: int) -> Mapping[str, TrainedModel]:
    models, problems = train(trainable_choices(config.pipelines), training_data, seed)
    if problems:
        raise SiteError(f"jiang2015: {'; '.join(problems)}")
    return models


def _known_start(walk: SimulatedWalk) -> Fix:
    first = walk.recording.truth[0]
    return Fix(t_ns=first.t_ns, floor=first.floor, xy=first.xy, covariance=_START_SIGMA_M**2 * np.eye(2))
