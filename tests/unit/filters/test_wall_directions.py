"""Which way walls run, and what a particle filter learns from a corridor."""

from __future__ import annotations

import math

import numpy as np
import pytest
from walks import errors, fixes, fold, walk

from tickfix import config
from tickfix.api import Bools, Context, Floats, Floor, Motion
from tickfix.api.errors import ConfigError
from tickfix.registry import discover
from tickfix.toolkit.walkable_area import WallDirections
from tickfix_filters.fusion_model import FusionPfParams, wall_alignment
from tickfix_filters.fusion_pf import FusionPf

HALL = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 20.0], [0.0, 20.0]])


def turned(ring: Floats, by_rad: float) -> Floats:
    """Turn a ring clockwise, as headings grow."""
    sine, cosine = math.sin(by_rad), math.cos(by_rad)
    return ring @ np.array([[cosine, -sine], [sine, cosine]])


def floor(*outline: Floats, walls: Floats | None = None) -> Floor:
    none = np.zeros((0, 2, 2))
    return Floor(name="F", width_m=40.0, height_m=40.0, outline=outline, walls=none if walls is None else walls)


def apart_rad(one: Floats, other: float) -> Floats:
    """Return how far directions are apart, modulo a right angle."""
    return np.abs(np.mod(one - other + math.pi / 4, math.pi / 2) - math.pi / 4)


@pytest.mark.parametrize("by_rad", [0.0, 0.3, 1.2, -0.7])
def test_walls_of_a_turned_hall_run_as_it_was_turned(by_rad: float) -> None:
    found = WallDirections(floor(turned(HALL, by_rad))).nearest_wall_heading_rad(
        np.random.default_rng(0).uniform(-20.0, 40.0, (50, 4, 2))
    )
    assert found.shape == (50, 4)
    assert apart_rad(found, by_rad).max() < 1e-6


def test_the_nearest_wall_counts_and_short_edges_do_not() -> None:
    slanting = np.array([[[15.0, 5.0], [18.0, 8.0]]])
    pillar = np.array([[3.0, 10.0], [3.5, 10.2], [3.2, 10.6]])
    found = WallDirections(floor(HALL, pillar, walls=slanting)).nearest_wall_heading_rad(
        np.array([[16.6, 6.4], [1.0, 10.0], [3.2, 9.5]])
    )
    assert found == pytest.approx([math.pi / 4, 0.0, 0.0], abs=1e-6)


def test_a_floor_without_walls_tells_nothing() -> None:
    walls = WallDirections(floor())
    assert np.isnan(walls.nearest_wall_heading_rad(np.zeros((3, 2)))).all()
    theta = np.linspace(0.0, 6.0, 7)[None]
    motion = Motion(t0_ns=0, t1_ns=200_000_000, distance_m=0.3, heading_rad=0.0)
    for directions in ({}, {"F": walls}):
        assert not wall_alignment(theta, np.zeros((1, 7, 2)), ["F"], [motion], directions, FusionPfParams()).any()


def test_ways_of_all_directions_weigh_one_on_average_and_those_along_walls_most() -> None:
    theta = np.linspace(0.0, 2.0 * math.pi, 720, endpoint=False)[None]
    params = FusionPfParams()
    for metres in (params.alignment_length_m, 0.25):
        motion = Motion(t0_ns=0, t1_ns=200_000_000, distance_m=metres, heading_rad=0.0)
        log_weights = wall_alignment(
            theta, np.full((1, 720, 2), 5.0), ["F"], [motion], {"F": WallDirections(floor(turned(HALL, 0.3)))}, params
        )
        weights = np.exp(log_weights * params.alignment_length_m / metres)
        assert weights.mean() == pytest.approx(1.0, abs=1e-4)
        assert apart_rad(theta[0, [int(weights.argmax())]], 0.3)[0] < 0.01
        assert weights.min() == pytest.approx(1.0 - params.wall_alignment, abs=0.01)


@pytest.mark.parametrize("sigma_rad", [0.05, 0.5])
def test_weights_are_finite_at_both_ends_of_what_sigma_may_be(sigma_rad: float) -> None:
    filtered = f'filter = {{ use = "fusion-pf", alignment_sigma_rad = {sigma_rad} }}'
    assert config.parse_config(f'[pipelines.p]\npdr = "steps"\nfingerprint = "wknn"\n{filtered}', "test", discover())
    theta = np.linspace(0.0, 2.0 * math.pi, 720, endpoint=False)[None]
    motion = Motion(t0_ns=0, t1_ns=200_000_000, distance_m=0.3, heading_rad=0.0)
    walls = {"F": WallDirections(floor(HALL))}
    params = FusionPfParams(alignment_sigma_rad=sigma_rad)
    found = wall_alignment(theta, np.full((1, 720, 2), 5.0), ["F"], [motion], walls, params)
    assert np.isfinite(found).all()
    assert found.max() > 0.0 > found.min()


@pytest.mark.parametrize("sigma_rad", [0.01, 0.6])
def test_other_sigmas_are_refused_by_name(sigma_rad: float) -> None:
    text = f'[pipelines.p]\npdr = "steps"\nfilter = {{ use = "fusion-pf", alignment_sigma_rad = {sigma_rad} }}'
    with pytest.raises(ConfigError, match="alignment_sigma_rad"):
        config.parse_config(text, "test", discover())


class Everywhere:
    """A map on which nobody ever meets a wall."""

    def contains(self, xy: Floats) -> Bools:
        return np.ones(len(xy), np.bool_)

    def crosses(self, a: Floats, b: Floats) -> Bools:
        return np.zeros(len(a), np.bool_)

    def nearest_free(self, xy: Floats) -> Floats:
        return xy

    def snap(self, previous: Floats | None, xy: Floats) -> Floats:
        return xy


@pytest.mark.parametrize("off_rad", [0.35, -0.35])
def test_a_corridor_teaches_how_far_the_compass_is_off(off_rad: float) -> None:
    true_motions, places = walk(60.0, lambda _: 0.3)
    motions = [
        Motion(
            t0_ns=motion.t0_ns,
            t1_ns=motion.t1_ns,
            distance_m=motion.distance_m,
            heading_rad=0.3 + off_rad,
            heading_bias_sigma_rad=0.3,
            heading_sigma_rad=0.1,
            steps=motion.steps,
        )
        for motion in true_motions
    ]
    corridor = turned(np.array([[-15.0, -20.0], [15.0, -20.0], [15.0, 90.0], [-15.0, 90.0]]), 0.3)
    context = Context(floors={"F": floor(corridor)}, maps={"F": Everywhere()})
    heading: dict[float, list[float]] = {0.0: [], 0.6: []}
    error: dict[float, list[float]] = {0.0: [], 0.6: []}
    for seed in range(5):
        seen = fixes(places, np.random.default_rng(seed), 6.0)
        for share, told_off in heading.items():
            pf = FusionPf(FusionPfParams(wall_alignment=share), context)
            folded = fold(pf, motions, seen, np.random.default_rng(seed))
            told = pf.estimate(folded[-1][0]).heading_rad
            assert told is not None
            told_off.append(abs(told - 0.3))
            error[share].append(float(errors(pf, folded, places)[100:].mean()))
    assert max(heading[0.6]) < 0.1
    assert np.mean(heading[0.6]) < 0.5 * np.mean(heading[0.0])
    assert np.mean(error[0.6]) < np.mean(error[0.0])
