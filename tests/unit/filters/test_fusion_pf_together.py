"""Batches of ``fusion-pf`` as a crowd makes them: more devices than fit together, of unlike size, on several floors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tickfix.api import TICK_NS, Context, Fix, Motion, Observation, pack
from tickfix.testing import world
from tickfix.toolkit.fix_errors import FloorHysteresis
from tickfix.toolkit.particles import normal_pairs
from tickfix_filters.fusion_model import Particles, batches
from tickfix_filters.fusion_pf import FusionPf, FusionPfParams

MAPPED = world.context(maps=world.reference_maps())
STEP = Motion(t0_ns=0, t1_ns=TICK_NS, distance_m=0.3, heading_rad=0.4, distance_sigma_m=0.05, steps=1)


def begun(particles: int, floor: str = "F1", seed: int = 0) -> Particles:
    fix = Fix(t_ns=0, floor=floor, xy=[4.0, 2.0], covariance=np.eye(2))
    return FusionPf(FusionPfParams(particles=particles), MAPPED).begin(fix, world.rng(seed))


def test_states_of_unlike_size_and_on_unlike_floors_are_folded_together_as_alone() -> None:
    pf = FusionPf(FusionPfParams(), MAPPED)
    states = [begun(n, floor, n) for n in (7, 7, 300, 2, 7) for floor in ("F2", "F1", "nowhere")]
    every = range(len(states))
    seen = [
        [Observation(t_ns=TICK_NS, source="t", fix=Fix(t_ns=TICK_NS, floor="F1", xy=[4.5, 2.0]))] * (d % 3)
        for d in every
    ]
    alone = [pf.step(states[d], STEP, seen[d], world.rng(d)) for d in every]
    together = pf.step_many(states, [STEP] * len(states), seen, [world.rng(d) for d in every])
    assert list(map(pack, together)) == list(map(pack, alone))
    assert [pack(b) for b in pf.estimate_many([s for s, _ in alone])] == [pack(pf.estimate(s)) for s, _ in alone]


def test_some_that_must_be_drawn_anew_and_some_that_need_not_are_told_apart() -> None:
    pf = FusionPf(FusionPfParams(particles=50), Context())
    equal, hopeless = begun(50), replace(begun(50), log_weights=np.full(50, -np.inf))
    few = replace(begun(50), log_weights=np.where(np.arange(50) < 5, 0.0, -40.0))
    states = [equal, few, hopeless, few, equal]
    moved = pf.predict_many(states, [STEP] * 5, [world.rng(d) for d in range(5)])
    assert [len(np.unique(state.scale)) for state in moved] == [50, 5, 50, 5, 50]
    assert not any(state.log_weights.any() for state in (moved[1], moved[3]))
    assert (moved[2].log_weights == -np.inf).all()


def test_no_device_at_all_is_nothing_to_do() -> None:
    pf = FusionPf(FusionPfParams(), Context())
    assert pf.step_many([], [], [], []) == []
    assert pf.estimate_many([]) == []


def test_a_crowd_is_cut_into_batches_of_equal_size_that_hold_everyone_once() -> None:
    sizes = [500] * 150 + [100_000, 100_000] + [30] * 3 + [500]
    states = [Particles(FloorHysteresis("F"), np.zeros((n, 2)), *[np.zeros(n)] * 4, 0, np.zeros(2)) for n in sizes]  # type: ignore[arg-type]
    cut = list(batches(states))
    assert [d for batch in cut for d in range(batch.start, batch.stop)] == list(range(len(states)))
    assert all(len({sizes[d] for d in range(batch.start, batch.stop)}) == 1 for batch in cut)
    assert max(sum(sizes[batch]) for batch in cut if sizes[batch.start] == 500) * 8 < 2**20


def test_a_state_does_not_keep_the_arrays_of_the_others_alive() -> None:
    pf = FusionPf(FusionPfParams(), Context())
    moved = pf.predict_many([begun(500)] * 8, [STEP] * 8, [world.rng(d) for d in range(8)])
    for state in moved:
        for array in (state.xy, state.bias_rad, state.scale, state.error, state.log_weights):
            assert array.base is None or array.base.nbytes <= array.nbytes


def test_a_batch_refuses_what_one_of_it_refuses() -> None:
    pf = FusionPf(FusionPfParams(), Context())
    backwards = replace(STEP, t0_ns=2 * TICK_NS)
    with pytest.raises(ValueError, match="math domain"):
        pf.step_many([begun(9)] * 3, [STEP, backwards, STEP], [()] * 3, [world.rng(d) for d in range(3)])


@pytest.mark.parametrize("n", [2, 1000])
def test_normal_numbers_come_from_each_generator_alone(n: int) -> None:
    one, other = normal_pairs([world.rng(0), world.rng(1)], n)
    for drawn, again in zip((one, other), normal_pairs([world.rng(1)], n), strict=True):
        assert (drawn[1] == again[0]).all()


def test_normal_numbers_are_normal_and_independent() -> None:
    drawn = np.concatenate(normal_pairs([world.rng(d) for d in range(4)], 50_000)).astype(np.float64)
    n = drawn.size
    assert drawn.mean() == pytest.approx(0.0, abs=4.0 / n**0.5)
    assert drawn.var() == pytest.approx(1.0, abs=4.0 * (2.0 / n) ** 0.5)
    assert (drawn**4).mean() == pytest.approx(3.0, abs=4.0 * (96.0 / n) ** 0.5)
    assert np.quantile(drawn, [0.025, 0.16, 0.84, 0.975]) == pytest.approx([-1.96, -0.9945, 0.9945, 1.96], abs=0.02)
    correlation = np.corrcoef(drawn) - np.eye(len(drawn))
    assert np.abs(correlation).max() < 4.5 / 50_000**0.5
    assert np.isfinite(drawn).all()
