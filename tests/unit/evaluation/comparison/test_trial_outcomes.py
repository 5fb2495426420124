"""What is kept of a walk, and where."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tickfix.api import TICK_NS
from tickfix.api.packing import pack, unpack
from tickfix.evaluation.comparison.trial_outcomes import Diagnosis, OutcomeStore, TrialOutcome, diagnose, outcome_key


@pytest.fixture
def outcome(trial_of: Any) -> TrialOutcome:
    kept: TrialOutcome = trial_of("walk", a=[None, (2, 4), (3, 3), (4, 0), (5, 0), (6, 0), (7, 0)]).outcomes["a"]
    return kept


def test_an_outcome_holds_errors_coverage_digests_and_a_sketch(outcome: TrialOutcome) -> None:
    assert outcome.at_samples.error_m[1:4].tolist() == [4.0, 3.0, 0.0]
    assert outcome.covered.tolist() == [True] * 6 + [False]  # the survey ended at x = 3 m, and 3 m count as covered
    assert outcome.first_position_s == pytest.approx(0.2)  # the first event is the first waypoint
    assert outcome.statuses == (("initialising", 1), ("tracking", 6))
    assert outcome.thinned_track.xy.tolist() == [[2.0, 4.0], [7.0, 0.0]]  # every fifth
    assert outcome.intake == (("accepted", 10),)
    assert len(outcome.published) == 64
    assert len(outcome.truth) == 7


def test_an_outcome_survives_the_store_bit_for_bit(outcome: TrialOutcome, tmp_path: Path) -> None:
    store, key = OutcomeStore(tmp_path / "kept"), outcome_key({"walk": "w"})
    assert not store.has(key)
    assert store.get(key) is None
    store.put(key, outcome)
    assert store.has(key)
    again = store.get(key)
    assert again is not None
    assert pack(again) == pack(outcome)
    assert again.at_samples.error_m.tobytes() == outcome.at_samples.error_m.tobytes()
    assert [path.name for path in (tmp_path / "kept").rglob(".*")] == []


@pytest.mark.parametrize("damage", [b"", b"\x93\x01", b"junk", None])
def test_a_damaged_file_counts_as_missing(outcome: TrialOutcome, tmp_path: Path, damage: bytes | None) -> None:
    store, key = OutcomeStore(tmp_path), outcome_key({})
    store.put(key, outcome)
    (file,) = tmp_path.rglob("*.outcome")
    file.write_bytes(file.read_bytes()[:-40] if damage is None else damage)
    assert store.get(key) is None


def test_a_key_changes_with_every_part_and_not_with_their_order() -> None:
    assert outcome_key({"a": 1, "b": 2}) == outcome_key({"b": 2, "a": 1})
    assert len({outcome_key({"a": 1}), outcome_key({"a": 2}), outcome_key({"b": 1}), outcome_key({})}) == 4


def test_a_diagnosis_has_status_ages_nis_and_reasons(track_of: Any) -> None:
    track = track_of([None, (2, 4)])
    found = diagnose(track, np.array([0, TICK_NS, 2 * TICK_NS]))
    assert [one.status for one in found] == ["", "initialising", "tracking"]
    assert [str(one) for one in found[:2]] == ["no estimate yet", "initialising, no observation used yet"]
    told = Diagnosis(
        status="coasting",
        observation_age_s=14.25,
        motion_age_s=3.0,
        nis=9.21,
        reasons=(("recovered", 2),),
        failed_by="x",
    )
    assert str(told) == (
        "coasting, last observation used 14.2 s ago, no motion for 3.0 s, NIS 9.2, recovered (2 ×), failed: x"
    )


def test_outcomes_can_be_read_back_only_as_what_they_are(outcome: TrialOutcome) -> None:
    with pytest.raises(ValueError, match="expected"):
        unpack(pack(outcome.cost), TrialOutcome)
