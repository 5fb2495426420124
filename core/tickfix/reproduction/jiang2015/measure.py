"""One repetition of [jiang2015]'s experiments: train, track, and measure what its tables and figures show."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import Final

import numpy as np

from tickfix.api import Fix, Floats, SiteError, Survey, Trained
from tickfix.config import Config, parse
from tickfix.drivers.replay import replay
from tickfix.drivers.surveying import train, trainable
from tickfix.evaluation.run import prepare
from tickfix.plugins import Registry
from tickfix.reproduction.jiang2015.track import Tracked, tracked, with_given_fixes
from tickfix.reproduction.jiang2015.twin import twin
from tickfix.simulation import SimulatedWalk
from tickfix.site.site import Site

GIVEN_SIGMA_M: Final = (0.1, 0.25, 0.5, 1.0, 2.0)
"""Errors of location results that are given, per coordinate."""
_START_SIGMA_M: Final = 0.1
_DRAWN: Final = 20
"""Of a true way, one instant in so many is kept for pictures: ten a second."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Measured:
    """What one seed gave.

    Attributes:
        window_mse: by window length in ms, (velocity in m²/s², heading in rad²).
        tracks: by pipeline, one for each walk.
        given: by error of the location results given (per coordinate, m) and pipeline, the mean error in metres.
        truth: of each walk, (n, 2) metres.
        failures: stage calls that failed.
    """

    window_mse: Mapping[int, tuple[float, float]]
    tracks: Mapping[str, tuple[Tracked, ...]]
    given: Mapping[float, Mapping[str, float]]
    truth: tuple[Floats, ...]
    failures: Mapping[str, int]

    def mean_error_m(self, pipeline: str) -> float:
        """Return the mean over all ticks of all walks."""
        return float(np.concatenate([track.error_m for track in self.tracks[pipeline]]).mean())

    def mean_located_m(self, pipeline: str) -> float:
        """Return the mean over all location results of all walks."""
        return float(np.concatenate([track.located_m for track in self.tracks[pipeline]]).mean())


def measure(registry: Registry, seed: int) -> Measured:
    """Run all experiments once.

    Raises:
        SiteError: when something cannot be trained.
    """
    scene = twin(seed)
    config = _configured("pipelines.toml", seed, registry)
    models = _trained(config, scene.lessons, seed)
    site = Site(name="jiang2015", floors=(scene.floor,), radio_map=scene.lessons.radio_map, models=models)
    tracks: dict[str, list[Tracked]] = {pipeline.name: [] for pipeline in config.pipelines}
    failures: Counter[str] = Counter()
    # Motion needs a start that is told; Wi-Fi alone finds its own.
    for with_motion in (True, False):
        names = [p.name for p in config.pipelines if (p.pdr is not None) == with_motion]
        bench = prepare(site, config.only(names))
        for walk in scene.walks:
            start = _start(walk) if with_motion else None
            replayed = replay(walk.recording, bench.pipelines, bench.settings, start=start)
            failures.update(replayed.failures)
            for pipeline in bench.pipelines:
                tracks[pipeline.name].append(tracked(pipeline, replayed, walk))
    return Measured(
        window_mse=_window_mse(scene.lessons, seed, registry),
        tracks={name: tuple(found) for name, found in tracks.items()},
        given=_with_given_fixes(site, scene.walks, seed, registry),
        truth=tuple(walk.trajectory.xy[::_DRAWN] for walk in scene.walks),
        failures=dict(failures),
    )


def _window_mse(lessons: Survey, seed: int, registry: Registry) -> dict[int, tuple[float, float]]:
    config = _configured("windows.toml", seed, registry)
    models = _trained(config, lessons, seed)
    found = {}
    for pipeline in config.pipelines:
        if pipeline.pdr is not None:
            velocity, heading = np.asarray(models[pipeline.pdr.model]["window_mse"]).tolist()
            found[int(pipeline.name)] = (velocity, heading)
    return found


def _with_given_fixes(
    site: Site, walks: tuple[SimulatedWalk, ...], seed: int, registry: Registry
) -> dict[float, dict[str, float]]:
    bench = prepare(site, _configured("given.toml", seed, registry))
    found = {}
    for sigma_m in GIVEN_SIGMA_M:
        errors: dict[str, list[Floats]] = {pipeline.name: [] for pipeline in bench.pipelines}
        for n, walk in enumerate(walks):
            recording = with_given_fixes(walk, sigma_m, np.random.default_rng([seed, n]))
            replayed = replay(recording, bench.pipelines, bench.settings, start=_start(walk))
            for pipeline in bench.pipelines:
                errors[pipeline.name].append(tracked(pipeline, replayed, walk).error_m)
        found[sigma_m] = {name: float(np.concatenate(each).mean()) for name, each in errors.items()}
    return found


def pipelines_in(file: str) -> str:
    """Return the text of one of this folder's configurations."""
    return files("tickfix.reproduction.jiang2015").joinpath(file).read_text("utf-8")


def _configured(file: str, seed: int, registry: Registry) -> Config:
    config = parse(pipelines_in(file), file, registry)
    return replace(config, kernel=replace(config.kernel, seed=seed))


def _trained(config: Config, lessons: Survey, seed: int) -> Mapping[str, Trained]:
    models, problems = train(trainable(config.pipelines), lessons, seed)
    if problems:
        raise SiteError(f"jiang2015: {'; '.join(problems)}")
    return models


def _start(walk: SimulatedWalk) -> Fix:
    first = walk.recording.truth[0]
    return Fix(t_ns=first.t_ns, floor=first.floor, xy=first.xy, covariance=_START_SIGMA_M**2 * np.eye(2))
