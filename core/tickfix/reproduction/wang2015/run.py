"""One seed: the twin is drawn, surveyed and walked, and every scheme's error is taken at every epoch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tickfix.api import TICK_NS, Estimate, Floats, SiteError
from tickfix.config import parse
from tickfix.drivers.replay import known_start, replay
from tickfix.drivers.surveying import train, trainable
from tickfix.evaluation.run import prepare
from tickfix.plugins import Registry
from tickfix.reproduction.wang2015.gross import on_odometry, on_wifi
from tickfix.reproduction.wang2015.schemes import DISTURBED, aided, dead_reckoning, wifi_alone
from tickfix.reproduction.wang2015.walks import FIX_S, Twin, draw_twin
from tickfix.site.site import Site

_FIRST_EPOCH = 2
"""A matrix of two measurements takes two epochs."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Walked:
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


def run_seed(registry: Registry, seed: int) -> Walked:
    """Draw the twin of a seed and let every scheme follow the test walk.

    Raises:
        SiteError: when an algorithm cannot be trained.
        TickfixError: when one cannot be built.
    """
    twin = draw_twin(seed)
    sigma_m = calibrated_sigma_m(twin, registry)
    schemes, alone = (parse(text, "wang2015", registry) for text in (aided(sigma_m), dead_reckoning()))
    choices = [choice for choice in trainable((*schemes.pipelines, *alone.pipelines)) if choice.offer.kind == "pdr"]
    models, problems = train(choices, twin.survey, seed)
    if problems:
        raise SiteError(f"wang2015: {'; '.join(problems)}")
    site = replace(_site(twin), models=models)
    begin_ns = int(twin.walk.t_ns[0])
    bench = prepare(site, schemes)
    by_name = {pipeline.name: pipeline for pipeline in bench.pipelines}
    disturbed = [put(by_name[name], begin_ns) for put in (on_wifi, on_odometry) for name in DISTURBED]
    recording = twin.walk.recording
    followed = replay(recording, (*bench.pipelines, *disturbed), bench.settings)
    reckoned = replay(recording, prepare(site, alone).pipelines, bench.settings, start=known_start(recording))
    published = {**followed.published, **reckoned.published}
    last = int((int(twin.walk.t_ns[-1]) - begin_ns) / (FIX_S * 1e9))
    t_s = FIX_S * np.arange(_FIRST_EPOCH, last + 1, dtype=np.float64)
    ticks = ((begin_ns + np.rint(t_s * 1e9).astype(np.int64)) // TICK_NS).tolist()
    return Walked(
        seed=seed,
        t_s=t_s,
        truth=twin.walk.trajectory.xy_at(t_s),
        xy={name: _at([estimate for estimate, _ in said], ticks) for name, said in published.items()},
        failures={**followed.failures, **reckoned.failures},
    )


def calibrated_sigma_m(twin: Twin, registry: Registry) -> float:
    """Return σ per axis of the Wi-Fi positions of the calibration walks, metres."""
    pipelines = prepare(_site(twin), parse(wifi_alone(), "wang2015", registry)).pipelines
    squares = []
    for walk in twin.calibration:
        for fixes in replay(walk.recording, pipelines).fixes.values():
            t_s = np.array([fix.t_ns - int(walk.t_ns[0]) for fix in fixes]) * 1e-9
            squares.append((np.array([fix.xy for fix in fixes]) - walk.trajectory.xy_at(t_s)) ** 2)
    return float(np.sqrt(np.concatenate(squares).mean()))


def _site(twin: Twin) -> Site:
    return Site(name="wang2015", floors=twin.building.floors, radio_map=twin.radio_map)


def _at(estimates: Sequence[Estimate], ticks: Sequence[int]) -> Floats:
    """Return the places (n, 2) of these ticks, NaN where a scheme had none."""
    places = {estimate.tick: estimate.belief.xy for estimate in estimates if estimate.belief is not None}
    return np.array([places.get(tick, np.full(2, np.nan)) for tick in ticks])
