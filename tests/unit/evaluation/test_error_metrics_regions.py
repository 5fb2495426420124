"""NEES, ellipses and highest-density regions."""

from __future__ import annotations

import numpy as np
import pytest

from tickfix.api import Belief, Component
from tickfix.evaluation.error_metrics import density_level, ellipse_level, nees


def gaussian(xy: tuple[float, float], variance: tuple[float, float], floor: str = "F1") -> Belief:
    return Belief(floor=floor, xy=np.array(xy), covariance=np.diag(variance))


def test_nees_weighs_each_direction_by_its_variance() -> None:
    belief = gaussian((1, 1), (4, 9))
    assert nees(belief, "F1", np.array([3.0, 4.0])) == pytest.approx(2.0)  # 2²/4 + 3²/9
    turned = Belief(floor="F1", xy=np.zeros(2), covariance=np.array([[2.0, 1.0], [1.0, 2.0]]))
    assert nees(turned, "F1", np.array([1.0, 1.0])) == pytest.approx(2 / 3)  # the inverse is [[2, −1], [−1, 2]] / 3
    assert np.isnan(nees(belief, "F2", np.array([3.0, 4.0])))


def test_a_claim_of_perfection_gives_a_finite_nees() -> None:
    assert nees(gaussian((0, 0), (0, 0)), "F1", np.array([0.001, 0.0])) == pytest.approx(1.0)


def test_the_ellipse_of_a_gaussian_has_the_content_of_its_chi_squared() -> None:
    assert ellipse_level(np.array([0.0, 2 * np.log(2), -2 * np.log(0.05), np.nan])) == pytest.approx([0, 0.5, 0.95, 1])


def test_without_a_mixture_the_densest_region_is_the_ellipse() -> None:
    belief, truth = gaussian((0, 0), (4, 1)), np.array([2.0, 1.0])
    assert density_level(belief, "F1", truth) == pytest.approx(1 - np.exp(-1.0))
    assert density_level(belief, "F2", truth) == 1.0


def mixture(*parts: tuple[float, str, tuple[float, float]]) -> Belief:
    components = tuple(Component(weight=w, floor=f, xy=np.array(xy), covariance=np.eye(2)) for w, f, xy in parts)
    return Belief(floor="F1", xy=np.array([50.0, 0.0]), covariance=2500 * np.eye(2), mixture=components)


def test_two_far_modes_share_the_region_and_the_middle_is_outside() -> None:
    two = mixture((0.5, "F1", (0, 0)), (0.5, "F1", (100, 0)))
    at = [density_level(two, "F1", np.array(xy)) for xy in ([0.0, 0.0], [100.0, 1.5], [50.0, 0.0])]
    # Both modes are the same Gaussian: what is denser than a place at distance r has the content 1 − exp(−r²/2).
    assert at == pytest.approx([0.0, 1 - np.exp(-1.125), 1.0], abs=2 / 512)


def test_a_lighter_mode_comes_into_the_region_only_after_the_heavier_one() -> None:
    two = mixture((0.8, "F1", (0, 0)), (0.2, "F2", (0, 0)))
    # At the peak of the lighter one the heavier is denser within r² = 2 ln 4, which holds 1 − 1/4 of it.
    assert density_level(two, "F2", np.zeros(2)) == pytest.approx(0.8 * 0.75, abs=1 / 512)
    assert density_level(two, "F3", np.zeros(2)) == 1.0


def test_honest_beliefs_cover_as_often_as_they_say() -> None:
    rng = np.random.default_rng(5)
    belief = mixture((0.7, "F1", (0, 0)), (0.3, "F1", (3, 0)))
    draws = rng.standard_normal((3000, 2)) + np.where(rng.random((3000, 1)) < 0.7, 0.0, 3.0) * [1.0, 0.0]
    levels = np.array([density_level(belief, "F1", xy) for xy in draws[:1500]])
    for p in (0.5, 0.9, 0.95):
        assert np.mean(levels <= p) == pytest.approx(p, abs=4 * np.sqrt(p * (1 - p) / 1500))
