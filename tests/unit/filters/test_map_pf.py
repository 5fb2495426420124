"""The map-aided particle filter against a Kalman filter where one is exact, and held to a map where one is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from walks import errors, fixes, fold, walk

from tickfix.api import TICK_NS, Bools, Context, Fix, Floats, Motion, Observation
from tickfix_filters.fading_ekf import FadingEkf, FadingEkfParams, extrapolate
from tickfix_filters.map_pf import MapParticles, MapPf, MapPfParams

GROSS = {200: (10.0, 0.0), 300: (-10.0, 0.0), 400: (10.0, 0.0)}


class Corridor:
    """A corridor along y, |x| ≤ 1.5 m, between y = −5 and 200 m."""

    def contains(self, xy: Floats) -> Bools:
        inside: Bools = (np.abs(xy[:, 0]) <= 1.5) & (xy[:, 1] >= -5.0) & (xy[:, 1] <= 200.0)
        return inside

    def crosses(self, a: Floats, b: Floats) -> Bools:
        return self.contains(a) != self.contains(b)

    def nearest_free(self, xy: Floats) -> Floats:
        return np.column_stack([np.clip(xy[:, 0], -1.5, 1.5), np.clip(xy[:, 1], -5.0, 200.0)])

    def snap(self, previous: Floats | None, xy: Floats) -> Floats:
        return self.nearest_free(xy[None])[0]


MAPPED = Context(maps={"F": Corridor()})


def north(t_s: float) -> float:
    return 0.0


def test_without_a_map_many_particles_are_the_kalman_filter_of_the_ekfs_places() -> None:
    motions, places = walk(20.0, lambda t: 0.7)
    seen = fixes(places, np.random.default_rng(2), 1.0)
    pf = MapPf(MapPfParams(particles=20_000), Context())
    folded = fold(pf, motions, seen, np.random.default_rng(3))
    p = pf.params
    m, P = seen[0].xy, 1.0
    for k, (state, _) in enumerate(folded[1:], 1):
        m, P = m + places[k] - places[k - 1], P + 0.2 * p.diffusion_m**2
        if k in seen:
            P += p.jitter_sigma_m**2
            K = P / (P + p.sigma_m**2)
            m, P = m + K * (extrapolate(state.ekf, p)[0] - m), (1.0 - K) * P
        belief = pf.estimate(state)
        assert belief.xy == pytest.approx(m, abs=0.05)
        assert belief.covariance == pytest.approx(P * np.eye(2), abs=0.05 * P + 0.01)


def gross_errors(algorithm: MapPf | FadingEkf, seed: int) -> Floats:
    rng = np.random.default_rng(seed)
    motions, places = walk(100.0, north)
    return errors(algorithm, fold(algorithm, motions, fixes(places, rng, gross=GROSS), rng), places)[list(GROSS)]


@pytest.mark.parametrize("preset", ["wang2015", "wang2015-50"])
def test_gross_errors_through_walls_hurt_it_less_than_the_ekf(preset: str) -> None:
    mwpo = MapPf(MapPfParams(**MapPf.presets[preset].values), MAPPED)
    wpo = FadingEkf(FadingEkfParams(), MAPPED)
    ours, theirs = (np.mean([gross_errors(a, seed) for seed in range(8)]) for a in (mwpo, wpo))
    assert ours < 1.6
    assert ours < 0.6 * theirs


def test_no_living_particle_is_outside_of_the_map() -> None:
    rng = np.random.default_rng(0)
    motions, places = walk(60.0, north)
    mwpo = MapPf(MapPfParams(particles=50), MAPPED)
    for state, _ in fold(mwpo, motions, fixes(places, rng, 3.0), rng):
        alive = np.isfinite(state.log_weights)
        assert alive.any()
        assert MAPPED.maps["F"].contains(state.xy[alive]).all()


def at(y: float, k: int) -> Observation:
    return Observation(
        t_ns=k * TICK_NS, source="test", fix=Fix(t_ns=k * TICK_NS, floor="F", xy=[0.0, y], covariance=np.eye(2))
    )


def begun(mwpo: MapPf) -> MapParticles:
    fix = at(0.0, 0).fix
    assert fix is not None
    return mwpo.begin(fix, np.random.default_rng(0))


def test_it_begins_anew_when_every_particle_has_died() -> None:
    mwpo = MapPf(MapPfParams(particles=50), MAPPED)
    leap = Motion(t0_ns=0, t1_ns=TICK_NS, distance_m=8.0, heading_rad=np.pi / 2)  # sideways, through the wall
    state, report = mwpo.step(begun(mwpo), leap, [], np.random.default_rng(1))
    assert report.reasons == ("all particles died",)
    assert MAPPED.maps["F"].contains(state.xy).all()
    assert np.isfinite(state.log_weights).all()


def test_one_far_fix_is_borne_and_several_in_a_row_free_what_the_map_has_locked_out() -> None:
    mwpo = MapPf(MapPfParams(particles=50), MAPPED)
    rng, state, reasons = np.random.default_rng(1), begun(mwpo), []
    for k in range(1, 9):
        # Fixes leap to y = 60 m and stay there, while motion says that nobody moves.
        state, report = mwpo.step(
            state, Motion(t0_ns=(k - 1) * TICK_NS, t1_ns=k * TICK_NS, heading_rad=0.0), [at(60.0, k)], rng
        )
        reasons.append([r for r in report.reasons if "locked" in r])
    assert not any(reasons[:2])
    assert any(reasons)
    assert mwpo.estimate(state).xy[1] > 50.0


def test_without_a_compass_the_particles_walk_with_the_ekfs_speed() -> None:
    rng = np.random.default_rng(0)
    motions, places = walk(60.0, north)
    blind = [replace(m, heading_rad=None) for m in motions]
    mwpo = MapPf(MapPfParams(), MAPPED)
    assert errors(mwpo, fold(mwpo, blind, fixes(places, rng), rng), places)[50:].mean() < 1.5


def test_a_gross_error_of_the_odometer_moves_particles_at_once_or_not_before_the_next_fix() -> None:
    motions, places = walk(60.0, north)
    motions[199] = replace(motions[199], distance_m=motions[199].distance_m + 10.0)  # along the corridor, at a fix
    off = {}
    for how in ("motion", "ekf"):
        rng = np.random.default_rng(0)
        mwpo = MapPf(MapPfParams(propagation=how), MAPPED)  # type: ignore[arg-type]
        off[how] = errors(mwpo, fold(mwpo, motions, fixes(places, rng), rng), places)[200]
    assert off["motion"] > 4.0
    assert off["ekf"] < 0.5 * off["motion"]


def test_particles_that_walk_by_the_ekf_keep_up_with_a_steady_walk() -> None:
    motions, places = walk(60.0, north)
    rng = np.random.default_rng(0)
    mwpo = MapPf(MapPfParams(propagation="ekf"), MAPPED)
    assert errors(mwpo, fold(mwpo, motions, fixes(places, rng), rng), places)[50:].mean() < 1.0
