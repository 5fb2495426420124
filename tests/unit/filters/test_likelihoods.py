"""Filters weigh by the likelihood of an observation where it offers one, and by its fix where not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tickfix.api import TICK_NS, Context, Fix, Floats, Motion, Observation
from tickfix.testing import world
from tickfix.toolkit.likelihoods import log_likelihood, offered_log_likelihood
from tickfix_filters.fusion_model import FusionPfParams
from tickfix_filters.fusion_pf import FusionPf

FIX = Fix(t_ns=0, floor="F1", xy=np.array([10.0, 10.0]), covariance=25.0 * np.eye(2))
STANDING = Motion(t0_ns=0, t1_ns=TICK_NS, heading_rad=0.0, stationary=True)


def gaussian(centre: tuple[float, float], sigma_m: float) -> Any:
    def evaluate(floor: str, xy: Floats) -> Floats:
        squares: Floats = ((xy - centre) ** 2).sum(axis=1)
        return -0.5 * squares / sigma_m**2 if floor == "F1" else np.full(len(xy), -np.inf)

    return evaluate


def filtered(*observations: Observation) -> tuple[Floats, Any]:
    pf = FusionPf(FusionPfParams(particles=4000, injection_rate=0.0), Context())
    state = pf.begin(FIX, world.rng(1))
    state, report = pf.step(state, STANDING, observations, world.rng(2))
    return pf.estimate(state).xy, report


def test_a_likelihood_without_a_fix_moves_the_particles_to_its_posterior() -> None:
    xy, report = filtered(Observation(t_ns=0, source="rtt", log_likelihood=gaussian((14.0, 10.0), 3.0)))
    sigma_m = min(5.0, FusionPfParams().initial_sigma_m)
    expected = 10.0 + 4.0 * sigma_m**2 / (sigma_m**2 + 9.0)  # the product of two Gaussians
    assert xy == pytest.approx([expected, 10.0], abs=0.25)
    assert report.used == 1
    assert 1.0 < report.diagnostics["ess"] < 4000.0


def test_a_likelihood_is_used_instead_of_the_fix_beside_it() -> None:
    fix = Fix(t_ns=0, floor="F1", xy=np.array([8.0, 10.0]), covariance=25.0 * np.eye(2))
    both = Observation(t_ns=0, source="x", fix=fix, log_likelihood=gaussian((14.0, 10.0), 1.0))
    assert filtered(both)[0][0] > 12.0
    assert filtered(Observation(t_ns=0, source="x", fix=fix))[0][0] < 10.0


def test_a_likelihood_that_no_particle_explains_is_gated() -> None:
    nowhere = Observation(t_ns=0, source="x", log_likelihood=lambda floor, xy: np.full(len(xy), -np.inf))
    xy, report = filtered(nowhere)
    assert (report.used, report.gated) == (0, 1)
    assert xy == pytest.approx(filtered()[0])


@pytest.mark.parametrize("returned", [np.zeros(3), np.full(2, np.nan), np.array([0.0, np.inf])])
def test_a_likelihood_that_cannot_be_is_refused(returned: Floats) -> None:
    observation = Observation(t_ns=0, source="odd", log_likelihood=lambda floor, xy: returned)
    with pytest.raises(ValueError, match="log_likelihood of odd"):
        offered_log_likelihood(observation, "F1", np.zeros((2, 2)))


def test_the_helper_falls_back_to_the_fix_and_to_nothing() -> None:
    xy = np.array([[10.0, 10.0], [15.0, 10.0]])
    observation = Observation(t_ns=0, source="x", fix=FIX)
    found = log_likelihood(observation, "F1", xy)
    assert found is not None
    np.testing.assert_allclose(found, [0.0, -3.0 * np.log1p(0.25)])
    assert log_likelihood(observation, "F2", xy) == pytest.approx([-np.inf, -np.inf])
    assert log_likelihood(Observation(t_ns=0, source="x"), "F1", xy) is None
