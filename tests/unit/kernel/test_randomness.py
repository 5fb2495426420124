"""Random streams are functions of their key."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from tickfix.kernel.determinism import RandomStreams

KEYS = [
    (seed, device, epoch, tick, stage, event)
    for seed in (0, 1)
    for device in ("a", "b", "ab")
    for epoch in (0, 1)
    for tick in (0, 1, 2**40)
    for stage in ("filter", "start")
    for event in (0, 1)
]


def draw(key: tuple[int, str, int, int, str, int], n: int = 64) -> np.ndarray:
    seed, device, *rest = key
    return RandomStreams(seed, device).at(*rest).random(n)


def test_the_same_key_gives_the_same_numbers_whatever_was_drawn_before() -> None:
    streams = RandomStreams(3, "d")
    first = streams.at(0, 17, "filter").standard_normal(5)
    streams.at(1, 4, "start").integers(0, 5, 3)
    streams.at(0, 18, "filter").random(dtype=np.float32)
    assert streams.at(0, 17, "filter").standard_normal(5).tobytes() == first.tobytes()


def test_every_part_of_the_key_matters_and_no_two_streams_overlap() -> None:
    drawn = {key: draw(key) for key in KEYS}
    for a, b in combinations(KEYS, 2):
        assert not np.intersect1d(drawn[a], drawn[b]).size


def test_streams_of_neighbouring_ticks_are_uncorrelated_and_uniform() -> None:
    streams = RandomStreams(0, "d")
    table = np.array([streams.at(0, k, "filter").random(400) for k in range(200)])
    correlation = np.corrcoef(table) - np.eye(200)
    assert np.abs(correlation).max() < 5.5 / np.sqrt(400)
    assert table.mean() == pytest.approx(0.5, abs=5 / np.sqrt(12 * table.size))


def test_numbers_are_the_same_on_every_machine() -> None:
    assert RandomStreams(0, "phone").at(0, 1, "filter").integers(0, 1000, 4).tolist() == GOLDEN


GOLDEN = [858, 273, 438, 297]
