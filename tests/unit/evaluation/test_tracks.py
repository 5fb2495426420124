"""Tracks and digests."""

from __future__ import annotations

import dataclasses
import hashlib
import struct
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tickfix.api import Belief, Component, Estimate, EventError, Status
from tickfix.evaluation.tracks import Track, digest, pooled_digest

GAUSSIAN = Component(weight=0.25, floor="F2", xy=np.array([5.0, 6.0]), covariance=np.eye(2))
BELIEF = Belief(
    floor="F1",
    xy=np.array([1.0, 2.0]),
    covariance=np.eye(2),
    floor_probabilities=(("F1", 0.75), ("F2", 0.25)),
    mixture=(GAUSSIAN,),
    speed_mps=1.2,
    heading_rad=0.5,
)
ESTIMATE = Estimate(
    device="phone",
    pipeline="fusion",
    epoch=0,
    tick=3,
    t_ns=600_000_000,
    status=Status.TRACKING,
    belief=BELIEF,
    motion_age_ns=10,
    observation_age_ns=20,
    innovation_m=1.5,
    nis=2.5,
    reasons=("recovered",),
)


def one(estimate: Estimate, closed_ns: int = 0) -> Track:
    return Track(
        pipeline=estimate.pipeline, device="phone", estimates=(estimate,), closed_ns=np.array([closed_ns], np.int64)
    )


def with_belief(**changes: Any) -> Estimate:
    return replace(ESTIMATE, belief=replace(BELIEF, **changes))


def with_component(**changes: Any) -> Estimate:
    return with_belief(mixture=(replace(GAUSSIAN, **changes),))


def next_bit(value: float) -> float:
    return float(np.nextafter(value, np.inf))


CHANGED = {
    "device": replace(ESTIMATE, device="other"),
    "epoch": replace(ESTIMATE, epoch=1),
    "tick": replace(ESTIMATE, tick=4),
    "t_ns": replace(ESTIMATE, t_ns=600_000_001),
    "status": replace(ESTIMATE, status=Status.COASTING),
    "belief": replace(ESTIMATE, belief=None),
    "motion_age_ns": replace(ESTIMATE, motion_age_ns=None),
    "observation_age_ns": replace(ESTIMATE, observation_age_ns=21),
    "innovation_m": replace(ESTIMATE, innovation_m=next_bit(1.5)),
    "nis": replace(ESTIMATE, nis=next_bit(2.5)),
    "failed_by": replace(ESTIMATE, failed_by="pdr"),
    "reasons": replace(ESTIMATE, reasons=()),
    "belief.floor": with_belief(floor="F2"),
    "belief.xy": with_belief(xy=np.array([1.0, next_bit(2.0)])),
    "belief.covariance": with_belief(covariance=np.diag([1.0, next_bit(1.0)])),
    "belief.floor_probabilities": with_belief(floor_probabilities=(("F1", next_bit(0.75)), ("F2", 0.25))),
    "belief.mixture": with_belief(mixture=()),
    "belief.speed_mps": with_belief(speed_mps=next_bit(1.2)),
    "belief.heading_rad": with_belief(heading_rad=None),
    "component.weight": with_component(weight=next_bit(0.25)),
    "component.floor": with_component(floor="F3"),
    "component.xy": with_component(xy=np.array([next_bit(5.0), 6.0])),
    "component.covariance": with_component(covariance=np.diag([1.0, 2.0])),
}


@pytest.mark.parametrize("name", CHANGED)
def test_the_digest_changes_with_any_bit_of_content(name: str) -> None:
    assert digest(one(CHANGED[name])) != digest(one(ESTIMATE))


def test_every_field_of_an_estimate_is_either_hashed_or_left_out_on_purpose() -> None:
    left_out = {"pipeline", "revision", "diagnostics"}
    fields = {field.name for field in dataclasses.fields(Estimate)} - left_out
    fields |= {f"belief.{field.name}" for field in dataclasses.fields(Belief)}
    fields |= {f"component.{field.name}" for field in dataclasses.fields(Component)}
    assert fields == set(CHANGED)


@given(st.text(), st.integers(0, 100), st.integers(0, 10**15))
def test_the_digest_is_free_of_the_pipelines_name_the_revision_and_the_time_of_closing(
    name: str, revision: int, closed_ns: int
) -> None:
    said = replace(ESTIMATE, pipeline=name, revision=revision, diagnostics={"ess": float(revision)})
    assert digest(one(said, closed_ns)) == digest(one(ESTIMATE))


@given(st.floats(allow_nan=False, width=64), st.floats(allow_nan=False, width=64))
def test_two_floats_have_one_digest_only_if_their_bytes_are_equal(a: float, b: float) -> None:
    same = struct.pack("<d", a) == struct.pack("<d", b)
    assert (digest(one(replace(ESTIMATE, nis=a))) == digest(one(replace(ESTIMATE, nis=b)))) is same


def test_a_numpy_number_and_an_integer_metre_have_the_digest_of_the_plain_float() -> None:
    plain = digest(one(replace(ESTIMATE, nis=2.0, motion_age_ns=7)))
    assert digest(one(replace(ESTIMATE, nis=np.float64(2.0), motion_age_ns=np.int64(7)))) == plain  # type: ignore[arg-type]
    assert digest(one(replace(ESTIMATE, nis=2, motion_age_ns=7))) == plain


def test_the_digest_of_a_track_without_ticks_is_that_of_no_bytes() -> None:
    empty = Track(pipeline="p", device="d", estimates=(), closed_ns=np.zeros(0, np.int64))
    assert digest(empty) == hashlib.sha256().hexdigest()


def test_the_digest_depends_on_the_order_of_what_was_said() -> None:
    first, second = replace(ESTIMATE, nis=1.0), replace(ESTIMATE, nis=2.0)
    tracks = [
        Track(pipeline="p", device="d", estimates=(a, replace(b, tick=4)), closed_ns=np.array([1, 2]))
        for a, b in ((first, second), (second, first))
    ]
    assert digest(tracks[0]) != digest(tracks[1])


def test_a_track_is_made_of_what_a_driver_collects_and_has_the_digest_of_its_estimates() -> None:
    later = replace(ESTIMATE, tick=4)
    track = Track.of("fusion", "phone", [(ESTIMATE, 5), (later, 7)])
    np.testing.assert_array_equal(track.closed_ns, [5, 7])
    assert list(track) == [ESTIMATE, later]
    assert digest(track) == digest([ESTIMATE, later])
    assert len(Track.of("fusion", "phone", [])) == 0


def test_a_pooled_digest_is_the_hash_of_the_walks_digests_in_their_order() -> None:
    a, b = hashlib.sha256(b"a"), hashlib.sha256(b"b")
    pooled = pooled_digest([a.hexdigest(), b.hexdigest()])
    assert pooled == hashlib.sha256(a.digest() + b.digest()).hexdigest()
    assert pooled != pooled_digest([b.hexdigest(), a.hexdigest()])


def test_a_track_whose_ticks_or_closing_times_run_backwards_is_refused() -> None:
    later = replace(ESTIMATE, tick=4)
    with pytest.raises(ValueError, match=r"found \(epoch, tick\) \(0, 3\) at index 1"):
        Track(pipeline="p", device="d", estimates=(later, ESTIMATE), closed_ns=np.array([1, 2]))
    with pytest.raises(ValueError, match="closed_ns: found a smaller time at index 1"):
        Track(pipeline="p", device="d", estimates=(ESTIMATE, later), closed_ns=np.array([2, 1]))


def test_a_track_needs_one_closing_time_per_tick_and_keeps_them_read_only() -> None:
    with pytest.raises(EventError, match="closed_ns"):
        Track(pipeline="p", device="d", estimates=(ESTIMATE,), closed_ns=np.array([1, 2]))
    with pytest.raises(ValueError, match="read-only"):
        one(ESTIMATE).closed_ns[0] = 1
