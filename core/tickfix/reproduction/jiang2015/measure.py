"""One repetition of [jiang2015]'s experiments: train, track, and measure what its tables and figures show."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import Final

import numpy as np

from tickfix.api import TICK_NS, Estimate, Fix, Floats, SiteError, Survey, Trained
from tickfix.config import Config, parse
from tickfix.drivers.replay import Replayed, replay
from tickfix.drivers.surveying import train, trainable
from tickfix.evaluation.run import Bench, prepare
from tickfix.plugins import Registry
from tickfix.reproduction.jiang2015.twin import Twin, twin
from tickfix.simulation import SimulatedWalk
from tickfix.site.site import Site

_START_SIGMA_M: Final = 0.1


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Tracked:
    """A pipeline on a walk.

    Attributes:
        t_s: (n,) of its ticks with a position, since the walk began.
        xy: (n, 2) published, metres.
        error_m: (n,) distance from the true place at the tick.
        located_m: (m,) the same, settled, at the ticks that brought a location result; empty without Wi-Fi.
        every_s: mean time from one published position to the next other one.
    """

    t_s: Floats
    xy: Floats
    error_m: Floats
    located_m: Floats
    every_s: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Measured:
    """What one seed gave.

    Attributes:
        window_mse: by window length in ms, (velocity in m²/s², heading in rad²).
        tracks: by pipeline, one for each walk.
        truth: of each walk, (n, 2) metres.
        failures: stage calls that failed.
    """

    window_mse: Mapping[int, tuple[float, float]]
    tracks: Mapping[str, tuple[Tracked, ...]]
    truth: tuple[Floats, ...]
    failures: Mapping[str, int]


def measure(seed: int, registry: Registry) -> Measured:
    """Run all experiments once.

    Raises:
        SiteError: when something cannot be trained.
    """
    scene = twin(seed)
    compared = _configured("windows.toml", seed, registry)
    models = _trained(compared, scene.lessons, seed)
    window_mse = {}
    for pipeline in compared.pipelines:
        if pipeline.pdr is not None:
            velocity, heading = np.asarray(models[pipeline.pdr.model]["window_mse"]).tolist()
            window_mse[int(pipeline.name)] = (velocity, heading)
    config = _configured("pipelines.toml", seed, registry)
    models = _trained(config, scene.lessons, seed)
    site = Site(name="jiang2015", floors=(scene.floor,), radio_map=scene.lessons.radio_map, models=models)
    moving = [p.name for p in config.pipelines if p.pdr is not None]
    resting = [p.name for p in config.pipelines if p.pdr is None]
    benches = (prepare(site, config.only(moving)), prepare(site, config.only(resting)))
    failures: Counter[str] = Counter()
    tracks: dict[str, list[Tracked]] = {name: [] for name in (*moving, *resting)}
    for walk in scene.walks:
        for bench, start in zip(benches, (_start(walk), None), strict=True):
            replayed = replay(walk.recording, bench.pipelines, bench.settings, start=start)
            failures.update(replayed.failures)
            for name, tracked in _tracked(bench, replayed, walk).items():
                tracks[name].append(tracked)
    return Measured(
        window_mse=window_mse,
        tracks={name: tuple(found) for name, found in tracks.items()},
        truth=_truth(scene),
        failures=dict(failures),
    )


def _configured(file: str, seed: int, registry: Registry) -> Config:
    text = files("tickfix.reproduction.jiang2015").joinpath(file).read_text("utf-8")
    config = parse(text, file, registry)
    return replace(config, kernel=replace(config.kernel, seed=seed))


def _trained(config: Config, lessons: Survey, seed: int) -> Mapping[str, Trained]:
    models, problems = train(trainable(config.pipelines), lessons, seed)
    if problems:
        raise SiteError(f"jiang2015: {'; '.join(problems)}")
    return models


def _start(walk: SimulatedWalk) -> Fix:
    first = walk.recording.truth[0]
    return Fix(t_ns=first.t_ns, floor=first.floor, xy=first.xy, covariance=_START_SIGMA_M**2 * np.eye(2))


def _tracked(bench: Bench, replayed: Replayed, walk: SimulatedWalk) -> dict[str, Tracked]:
    result = {}
    for pipeline in bench.pipelines:
        published = [e for e, _ in replayed.published[pipeline.name] if e.belief is not None]
        t_s, xy, error_m = _errors(published, walk)
        stage = pipeline.fingerprint
        ticks = set() if stage is None else {-(-fix.t_ns // TICK_NS) for fix in replayed.fixes[stage.key]}
        settled = [e for e in replayed.settled[pipeline.name] if e.tick in ticks and e.belief is not None]
        changes = t_s[1:][np.any(np.diff(xy, axis=0) != 0.0, axis=1)]
        result[pipeline.name] = Tracked(
            t_s=t_s,
            xy=xy,
            error_m=error_m,
            located_m=_errors(settled, walk)[2],
            every_s=float(np.diff(changes).mean()) if len(changes) > 1 else float(t_s[-1] - t_s[0]),
        )
    return result


def _errors(estimates: Sequence[Estimate], walk: SimulatedWalk) -> tuple[Floats, Floats, Floats]:
    """Return times (n,), places (n, 2) and errors (n,) of estimates with a belief."""
    t_s = (np.array([e.t_ns for e in estimates], np.int64) - walk.t_ns[0]) * 1e-9
    xy = np.array([e.belief.xy for e in estimates if e.belief is not None]).reshape(-1, 2)
    error_m: Floats = np.hypot(*(xy - walk.trajectory.xy_at(t_s)).T)
    return t_s, xy, error_m


def _truth(scene: Twin) -> tuple[Floats, ...]:
    return tuple(walk.trajectory.xy[::20] for walk in scene.walks)
