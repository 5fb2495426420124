"""The laws of the kernel, on every registered filter, on a simulated walk."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lab import SETTINGS, Folded, Lab, delayed, examples, fold, merged, numbered, split, track_digest, without_truth
from toys import plain, sabotaged

from tickfix.api import TICK_NS, Estimate, Event, PluginError, Status, Truth
from tickfix.kernel import Kernel, Pipeline

seeds = st.integers(0, 2**32 - 1)


def everything(lab: Lab) -> list[Event]:
    return numbered(without_truth(lab.events))


def same(a: Folded, b: Folded, lab: Lab, name: str) -> None:
    device = lab.events[0].device
    assert a.settled[device, name], "nothing was settled"
    assert any(e.belief is not None for e in a.settled[device, name]), "nothing was believed"
    assert a.settled_as(device, name) == b.settled_as(device, name)


@examples(6)
@given(seed=seeds, known=st.booleans())
def test_any_arrival_order_within_the_horizon_gives_the_same_settled_bytes(
    lab: Lab, name: str, seed: int, known: bool
) -> None:
    events, starts = everything(lab), {lab.events[0].device: lab.start} if known else {}
    in_order = fold([lab.pipelines[name]], events, starts=starts)
    shuffled = fold([lab.pipelines[name]], delayed(events, seed), starts=starts)
    assert not shuffled.intake["stale"]
    same(in_order, shuffled, lab, name)


@examples(6)
@given(pieces=st.integers(2, 5), seed=seeds, most=st.integers(2, 12))
def test_splitting_and_merging_batches_in_time_changes_neither_track(
    lab: Lab, name: str, pieces: int, seed: int, most: int
) -> None:
    device, pipelines = lab.events[0].device, [lab.pipelines[name]]
    events = merged(sorted(without_truth(lab.events), key=lambda e: e.t_ns), 1)
    whole = fold(pipelines, numbered(events))
    parts = fold(pipelines, numbered(p for e in events for p in split(e, pieces, seed, in_time=True)))
    joined = fold(pipelines, numbered(merged(events, most)))
    same(whole, parts, lab, name)
    same(whole, joined, lab, name)
    assert whole.said(device, name) == parts.said(device, name) == joined.said(device, name)


@examples(6)
@given(pieces=st.integers(2, 4), seed=seeds)
def test_splitting_batches_sensor_by_sensor_and_shuffling_the_parts_keeps_the_settled_bytes(
    lab: Lab, name: str, pieces: int, seed: int
) -> None:
    whole = fold([lab.pipelines[name]], everything(lab))
    events = enumerate(without_truth(lab.events))
    parts = [p for i, e in events for p in (split(e, pieces, seed, in_time=False) if i % 4 == 0 else [e])]
    same(whole, fold([lab.pipelines[name]], delayed(numbered(parts), seed)), lab, name)


@examples(3)
@given(seed=seeds)
def test_other_pipelines_and_other_devices_change_no_bytes(lab: Lab, name: str, seed: int) -> None:
    device, events = lab.events[0].device, everything(lab)
    alone = fold([lab.pipelines[name]], events)
    other = [replace(e, device="other") for e in delayed(events, seed)]
    rng = np.random.default_rng(seed)
    queues, interleaved = [list(events), other], []
    while any(queues):
        queue = queues[int(rng.integers(2))] or queues[0] or queues[1]
        interleaved.append(queue.pop(0))
    together = fold(lab.pipelines.values(), interleaved)
    same(alone, together, lab, name)
    assert alone.said(device, name) == together.said(device, name)


@examples(4)
@given(seed=seeds)
def test_packing_and_unpacking_every_state_changes_no_bytes(lab: Lab, name: str, seed: int) -> None:
    device, events = lab.events[0].device, delayed(everything(lab), seed)
    kept = fold([lab.pipelines[name]], events)
    repacked = fold([lab.pipelines[name]], events, replace(SETTINGS, repack=True))
    same(kept, repacked, lab, name)
    assert kept.said(device, name) == repacked.said(device, name)


@examples(6)
@given(seed=seeds, checkpoint_mb=st.sampled_from([1e-6, 0.001, 0.01, 0.05]))
def test_thinning_checkpoints_changes_no_bytes(lab: Lab, name: str, seed: int, checkpoint_mb: float) -> None:
    device, events = lab.events[0].device, delayed(everything(lab), seed)
    kept = fold([lab.pipelines[name]], events)
    thinned = fold([lab.pipelines[name]], events, replace(SETTINGS, checkpoint_mb=checkpoint_mb))
    same(kept, thinned, lab, name)
    assert kept.said(device, name) == thinned.said(device, name)


@examples(4)
@given(seed=seeds, checkpoint_mb=st.sampled_from([0.001, 8.0]))
def test_going_on_from_snapshots_changes_no_bytes(lab: Lab, name: str, seed: int, checkpoint_mb: float) -> None:
    device, events = lab.events[0].device, delayed(everything(lab), seed)
    restarts = set(np.random.default_rng(seed).integers(0, len(events), 3).tolist())
    used = replace(SETTINGS, checkpoint_mb=checkpoint_mb)
    through = fold([lab.pipelines[name]], events, used)
    restarted = fold([lab.pipelines[name]], events, used, restarts=restarts)
    same(through, restarted, lab, name)
    assert through.said(device, name) == restarted.said(device, name)


@examples(6)
@given(seed=seeds)
def test_truth_changes_no_bytes(lab: Lab, name: str, seed: int) -> None:
    device, rng = lab.events[0].device, np.random.default_rng(seed)
    disturbed = [
        replace(e, xy=rng.normal(0, 1e3, 2), t_ns=int(rng.integers(2**60)), seq=0) if isinstance(e, Truth) else e
        for e in lab.events
        if not isinstance(e, Truth) or rng.random() < 0.7
    ]
    told = fold([lab.pipelines[name]], lab.events)
    untold = fold([lab.pipelines[name]], disturbed)
    same(told, untold, lab, name)
    assert told.said(device, name) == untold.said(device, name)


@examples(6)
@given(share=st.floats(0.0, 1.0), seed=seeds)
def test_what_is_published_does_not_depend_on_what_comes_later(lab: Lab, name: str, share: float, seed: int) -> None:
    device, events = lab.events[0].device, delayed(everything(lab), seed)
    whole = fold([lab.pipelines[name]], events)
    prefix = fold([lab.pipelines[name]], events[: round(share * len(events))], finish=False)
    said = prefix.published.get((device, name), [])
    again = Folded({(device, name): whole.published[device, name][: len(said)]}, {}, {}, (), *[whole.intake] * 3)
    assert again.said(device, name) == prefix.said(device, name)


@examples(6)
@given(seed=seeds)
def test_every_message_has_exactly_one_outcome(lab: Lab, name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    events = delayed(numbered(lab.events), seed)
    again = [events[i] for i in rng.integers(0, len(events), 20)]
    folded = fold([lab.pipelines[name]], [*events, *again])
    assert len(folded.outcomes) == sum(folded.intake.values()) == len(events) + 20


def at_some_ticks(what: str, share: float, seed: int) -> Callable[[str, int], str]:
    """Return a fault that strikes at instants chosen by their time, so that a refolded tick fails again."""
    return lambda method, t_ns: what if np.random.default_rng([seed, t_ns]).random() < share else ""


@pytest.mark.parametrize("kind", ["pdr", "fingerprint", "filter"])
@examples(3)
@given(what=st.sampled_from(["raise", "nan", "type"]), share=st.sampled_from([0.05, 0.5, 1.0]), seed=seeds)
def test_a_failing_stage_keeps_its_state_is_named_and_leaves_the_other_pipelines_alone(
    lab: Lab, name: str, kind: str, what: str, share: float, seed: int
) -> None:
    device, events, tolerant = lab.events[0].device, delayed(everything(lab), seed), replace(SETTINGS, strict=False)
    pipeline = lab.pipelines[name]
    stage = getattr(pipeline, kind)

    def with_fault(fault: str) -> Pipeline:
        bad = sabotaged(stage, at_some_ticks(fault, share, seed))
        return replace(pipeline, name=fault, **{kind: bad})

    others = [next(p for p in lab.pipelines.values() if p is not pipeline), pipeline]
    failed = fold([with_fault(what), *others], events, tolerant)
    idle = fold([with_fault("idle"), pipeline], events, tolerant)
    assert not idle.failures
    for theirs, ours in zip(failed.settled[device, what], idle.settled[device, "idle"], strict=True):
        assert (theirs.belief is None) == (ours.belief is None)
        if theirs.belief is not None and ours.belief is not None:
            assert theirs.belief.xy.tobytes() == ours.belief.xy.tobytes()
            assert theirs.belief.covariance.tobytes() == ours.belief.covariance.tobytes()
        assert (theirs.status is Status.FAILED) == bool(theirs.failed_by)
        assert theirs.failed_by in ("", f"{stage.label}: {failure_of(what, kind)}")
    if share == 1.0:
        assert any(e.status is Status.FAILED for e in failed.settled[device, what])
        with pytest.raises(PluginError, match=kind):
            fold([with_fault(what)], events)
    alone = fold(others, events)
    for other in others:
        assert failed.settled_as(device, other.name) == alone.settled_as(device, other.name)
        assert failed.said(device, other.name) == alone.said(device, other.name)


def failure_of(what: str, kind: str) -> str:
    return {"raise": "RuntimeError", "nan": "FloatingPointError", "type": "ValueError"}[what]


def test_the_driver_may_close_every_tick_itself_and_the_settled_bytes_stay(lab: Lab, name: str) -> None:
    device, events = lab.events[0].device, everything(lab)
    by_data = fold([lab.pipelines[name]], events)
    kernel, settled, published = Kernel([lab.pipelines[name]], SETTINGS), [], []
    for event in events:
        kernel.feed(event)
        output = kernel.run(device, event.arrival_ns // TICK_NS)
        settled += output.settled
        published += output.published
    output = kernel.finish(device)
    settled += output.settled
    extra = len(settled) - len(by_data.settled[device, name])
    assert 0 <= extra <= 5  # the driver closed ticks that nothing was measured in
    theirs = Folded({}, {(device, name): settled[: len(settled) - extra]}, {}, (), *[kernel.intake] * 3)
    assert theirs.settled_as(device, name) == by_data.settled_as(device, name)
    assert [e.tick for e in published] == list(range(published[0].tick, published[-1].tick + 1))


@examples(1)
@given(seed=seeds)
def test_devices_that_run_together_say_what_each_says_alone(lab: Lab, name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    names = [f"phone {n}" for n in range(4)]
    queues = {
        phone: [replace(e, device=phone) for e in delayed(everything(lab), seed + n, 1.0 + 2.0 * n)]
        for n, phone in enumerate(names)
    }
    alone = {phone: fold([lab.pipelines[name]], events, finish=False) for phone, events in queues.items()}
    kernel = Kernel([lab.pipelines[name]], SETTINGS)
    said: dict[str, list[Estimate]] = {phone: [] for phone in names}
    while any(queues.values()):
        chosen = [phone for phone in names if queues[phone] and rng.random() < 0.7]
        for phone in chosen:
            kernel.feed(queues[phone].pop(0))
        for phone, output in zip(chosen, kernel.run_many([(p, None) for p in chosen]), strict=True):
            said[phone] += [*output.revised, *output.published]
    for phone in names:
        published = [e for e in said[phone] if not e.revision]
        assert track_digest(published) == alone[phone].said(phone, name)
        revised = [plain(e) for e in said[phone] if e.revision]
        assert revised == [plain(e) for e in alone[phone].revised.get((phone, name), [])]
