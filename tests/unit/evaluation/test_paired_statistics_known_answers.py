"""Simulated experiments whose answer is known: intervals hold it as often as they say, and differences are found."""

from __future__ import annotations

import numpy as np
import pytest

from tickfix.api import Floats, Rng
from tickfix.evaluation.paired_comparison import Conclusion, compare_with_baseline
from tickfix.evaluation.paired_statistics import STATISTICS, PairedErrors, interval, permutation_p_value

SIGMA_M = 2.0


def experiment(rng: Rng, chains: int, shift_m: float = 0.0, noise: float = 0.0) -> PairedErrors:
    """A site: chains of one to three walks of one to eight waypoints, two-dimensional errors that a chain shares."""
    walks_of = rng.integers(1, 4, chains)
    chain_of_walk = np.repeat(np.arange(chains), walks_of)
    samples = rng.integers(1, 9, len(chain_of_walk))
    walk = np.repeat(np.arange(len(chain_of_walk)), samples)
    chain = chain_of_walk[walk]
    xy = SIGMA_M * (0.6 * rng.standard_normal((chains, 2))[chain] + 0.8 * rng.standard_normal((len(walk), 2)))
    baseline = np.hypot(*xy.T)
    # The pipeline is worse by shift_m, here more and there less, and its errors are noisier by a factor.
    wobble = 0.5 * rng.standard_normal(chains)[chain] + 0.5 * rng.standard_normal(len(walk))
    pipeline = np.abs(baseline + (shift_m + wobble if shift_m else 0.0)) * (
        1.0 + noise * rng.standard_normal(len(walk))
    )
    return PairedErrors(baseline_m=baseline, pipeline_m=np.abs(pipeline), walk=walk, chain=chain)


@pytest.mark.parametrize(("chains", "metric"), [(8, "mean"), (25, "mean"), (60, "mean"), (25, "rmse"), (30, "median")])
def test_intervals_hold_the_truth_as_often_as_they_say(chains: int, metric: str) -> None:
    rng, statistic = np.random.default_rng(chains), STATISTICS[metric]
    endless = experiment(np.random.default_rng(99), 60_000, shift_m=0.5)
    every = np.ones((1, 60_000), dtype=np.int64)
    truth = float(
        statistic.of(endless.pipeline_m, endless.chain, every)[0]
        - statistic.of(endless.baseline_m, endless.chain, every)[0]
    )
    count = 600
    held = 0
    for _ in range(count):
        found = interval(experiment(rng, chains, shift_m=0.5), statistic, rng, replicates=400)
        assert found.low_m is not None
        assert found.high_m is not None
        held += found.low_m <= truth <= found.high_m
    # Chance alone moves the share by 0.9 points; 400 replicates and skew cost some more.
    assert 0.925 <= held / count <= 0.975


def test_a_true_null_is_rejected_as_often_as_the_level_says() -> None:
    rng = np.random.default_rng(7)
    p_values = []
    for _ in range(600):
        paired = experiment(rng, 15, shift_m=0.5)
        swap = rng.integers(0, 2, 15, dtype=np.int64)[paired.chain].astype(bool)
        a = np.where(swap, paired.pipeline_m, paired.baseline_m)
        b = np.where(swap, paired.baseline_m, paired.pipeline_m)
        null = PairedErrors(baseline_m=a, pipeline_m=b, walk=paired.walk, chain=paired.chain)
        p_values.append(permutation_p_value(null, STATISTICS["mean"], rng, permutations=199))
    for level in (0.05, 0.2, 0.5):
        assert np.mean(np.array(p_values) <= level) == pytest.approx(level, abs=4 * np.sqrt(level * (1 - level) / 600))


@pytest.mark.parametrize("metric", STATISTICS)
@pytest.mark.parametrize("seed", range(3))
def test_a_pipeline_against_itself_does_not_differ_whatever_the_seed(metric: str, seed: int) -> None:
    one = experiment(np.random.default_rng(seed), 20)
    same = PairedErrors(baseline_m=one.baseline_m, pipeline_m=one.baseline_m, walk=one.walk, chain=one.chain)
    (found,) = compare_with_baseline(
        {"B": same}, baseline="A", metric=metric, scope="all", statistic=STATISTICS[metric]
    )
    assert (found.conclusion, found.interval.difference_m, found.p) == (Conclusion.IDENTICAL, 0.0, 1.0)
    assert (found.interval.low_m, found.interval.high_m) == (0.0, 0.0)
    assert found.verdict == f"B and A do not differ at all ({same.walks} walks)"


def offset(rng: Rng, walks: int, move: Floats) -> PairedErrors:
    """Walks of eight waypoints with errors of 1 m per axis; the pipeline says every place moved by ``move``."""
    xy = rng.standard_normal((walks * 8, 2))
    walk = np.repeat(np.arange(walks), 8)
    return PairedErrors(baseline_m=np.hypot(*xy.T), pipeline_m=np.hypot(*(xy + move).T), walk=walk, chain=walk)


def test_half_a_metre_of_offset_is_found_with_its_sign_and_size() -> None:
    # |x| of a plane Gaussian moved by d is Rice distributed: mean √(π/2) L½(−d²/2), L½ the Laguerre function.
    from scipy.special import eval_genlaguerre  # noqa: PLC0415

    truth = np.sqrt(np.pi / 2) * (float(eval_genlaguerre(0.5, 0, -0.125)) - 1.0)
    assert truth == pytest.approx(0.0771, abs=1e-4)
    found, held = [], 0
    for seed in range(100):
        paired = offset(np.random.default_rng(seed), 60, np.array([0.5, 0.0]))
        (one,) = compare_with_baseline(
            {"B": paired}, baseline="A", metric="mean", scope="all", statistic=STATISTICS["mean"]
        )
        found.append(one)
        assert one.interval.low_m is not None
        assert one.interval.high_m is not None
        held += one.interval.low_m <= truth <= one.interval.high_m
    assert np.mean([one.interval.difference_m for one in found]) == pytest.approx(truth, abs=0.006)
    assert sum(one.conclusion is Conclusion.WORSE for one in found) > 95
    assert not any(one.conclusion is Conclusion.BETTER for one in found)
    assert held >= 89  # of 100 expected 95, less three standard deviations


def test_ten_per_cent_of_noise_is_found_with_its_sign_and_size() -> None:
    # Errors 10 % greater: a mean error of √(π/2) m grows by a tenth of it.
    rng, truth = np.random.default_rng(1), 0.1 * np.sqrt(np.pi / 2)
    walk = np.repeat(np.arange(60), 8)
    baseline = np.hypot(*rng.standard_normal((480, 2)).T)
    noisy = baseline * (1.1 + 0.1 * rng.standard_normal(480))
    paired = PairedErrors(baseline_m=baseline, pipeline_m=np.abs(noisy), walk=walk, chain=walk)
    (found,) = compare_with_baseline(
        {"B": paired}, baseline="A", metric="mean", scope="all", statistic=STATISTICS["mean"]
    )
    assert found.conclusion is Conclusion.WORSE
    assert found.interval.low_m is not None
    assert found.interval.high_m is not None
    assert found.interval.low_m <= truth <= found.interval.high_m
    assert found.interval.difference_m == pytest.approx(truth, abs=0.02)


def test_the_answer_does_not_depend_on_who_else_is_compared_but_p_does() -> None:
    one, two = (experiment(np.random.default_rng(seed), 12, shift_m=0.6) for seed in (1, 2))
    mean = STATISTICS["mean"]
    (alone,) = compare_with_baseline({"B": one}, baseline="A", metric="mean", scope="all", statistic=mean)
    both = compare_with_baseline({"C": two, "B": one}, baseline="A", metric="mean", scope="all", statistic=mean)
    assert both[1].interval == alone.interval
    assert both[1].p_uncorrected == alone.p_uncorrected
    assert both[1].p >= alone.p
    assert max(c.p for c in both) >= min(1.0, 2 * min(c.p_uncorrected for c in both))
