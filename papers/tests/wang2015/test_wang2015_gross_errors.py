"""Gross errors of [wang2015] tables 5 and 7: where they are put, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from tickfix.api import TICK_NS, Context, MotionSamples
from tickfix.registry import discover
from tickfix.testing import world
from tickfix_fingerprint.topology_knn import TopologyKnn, TopologyKnnParams
from tickfix_papers.wang2015 import seed_run
from tickfix_papers.wang2015.seed_run import (
    DISTURBED,
    EPOCHS_S,
    ON_ODOMETRY,
    ON_WIFI,
    REJECTING,
    DisturbedFingerprint,
    DisturbedOdometry,
    SeedRun,
    run_seed,
)
from tickfix_pdr.pseudo_odometry import PseudoOdometry, PseudoOdometryParams


@pytest.fixture(scope="module")
def walked() -> SeedRun:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(seed_run, "PARTICLES", ())  # filters of other sizes would only take time
        return run_seed(discover(), 77)


def test_only_the_fix_of_the_epoch_is_moved() -> None:
    inner = TopologyKnn(TopologyKnnParams(), world.context())
    window = world.readings("F1", (9.4, 5.4))
    fix = inner.locate(window)
    assert fix is not None
    for late_ns, moved in ((0, True), (1_900_000_000, True), (2_000_000_000, False), (-1, False)):
        disturbed = DisturbedFingerprint(inner, {window.t_ns + late_ns: (10.0, -3.0)})
        seen = disturbed.step(disturbed.start(), window)[1].fix
        assert seen is not None
        assert seen.xy - fix.xy == pytest.approx([10.0, -3.0] if moved else [0.0, 0.0])
        np.testing.assert_array_equal(seen.covariance, fix.covariance)


def test_only_the_reading_of_the_epoch_is_too_long() -> None:
    disturbed = DisturbedOdometry(PseudoOdometry(PseudoOdometryParams(), Context()), {20 * TICK_NS: 10.0})
    state, ways, travelled = disturbed.start(), [], []
    for k in range(30):
        state, motion = disturbed.step(state, MotionSamples(sensors={}, t0_ns=k * TICK_NS, t1_ns=(k + 1) * TICK_NS))
        ways.append(motion.distance_m)
        travelled.append(motion.travelled_m)
    assert ways == [10.0 if k == 19 else 0.0 for k in range(30)]
    assert travelled == [10.0 if k >= 19 else 0.0 for k in range(30)]


@pytest.mark.parametrize("suffix", [ON_WIFI, ON_ODOMETRY])
def test_schemes_part_from_their_undisturbed_selves_at_the_first_gross_error(walked: SeedRun, suffix: str) -> None:
    before, at = walked.t_s < EPOCHS_S[0], walked.t_s == EPOCHS_S[0]
    for scheme in DISTURBED:
        clean, disturbed = walked.xy[scheme], walked.xy[scheme + suffix]
        np.testing.assert_array_equal(clean[before], disturbed[before])
        if scheme.endswith(REJECTING) and suffix == ON_WIFI:
            continue  # the fix of that epoch is not input
        assert (clean[at] != disturbed[at]).any(), scheme


def test_every_scheme_has_a_place_at_every_epoch_and_no_stage_failed(walked: SeedRun) -> None:
    assert not walked.failures
    for scheme, xy in walked.xy.items():
        assert np.isfinite(xy).all(), scheme
    assert walked.residual_m("WPO", 60.0) == walked.error_m("WPO")[list(walked.t_s).index(60.0)]
