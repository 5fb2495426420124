"""What the laws are tested with: one pipeline per registered filter on a small simulated site, and folds to compare."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import numpy as np
from hypothesis import Phase, settings

from tickfix import config
from tickfix.api import Context, Estimate, Event, Fix, MotionSamples, Samples, Truth
from tickfix.evaluation.tracks import Track, digest
from tickfix.kernel import Kernel, KernelSettings, KernelSnapshot, MessageOutcome, Pipeline
from tickfix.registry import Registry, discover
from tickfix.simulation import office_building, simulate_survey, simulate_walks
from tickfix.site.survey_builder import survey_recordings

EFFORT = 30 if os.environ.get("TICKFIX_HYPOTHESIS") == "explore" else 1
"""By how much more hypothesis tries when it is to look for something new."""
PHASES = tuple(Phase) if EFFORT > 1 else (Phase.explicit, Phase.generate)
"""Folds take long: a counterexample is made smaller only where somebody waits for it."""
HORIZON_S = 2.0
SETTINGS = KernelSettings(horizon_s=HORIZON_S, strict=True)


def examples(usually: int) -> settings:
    """Return how hypothesis tries a law: with so many examples, and many more of them when exploring."""
    return settings(max_examples=usually * EFFORT, phases=PHASES)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Lab:
    """A site, its pipelines by name and the events of a walk in the order of their arrival."""

    pipelines: Mapping[str, Pipeline]
    events: tuple[Event, ...]
    start: Fix

    def __repr__(self) -> str:
        """Be short: hypothesis prints it with every counterexample."""
        return "the lab"

    def _repr_pretty_(self, printer: Any, _: bool) -> None:
        printer.text("the lab")


@dataclass(frozen=True, slots=True, eq=False)
class Folded:
    """What came out of a run, by device and pipeline."""

    published: Mapping[tuple[str, str], list[Estimate]]
    settled: Mapping[tuple[str, str], list[Estimate]]
    revised: Mapping[tuple[str, str], list[Estimate]]
    outcomes: tuple[MessageOutcome, ...]
    intake: Counter[str]
    measurements: Counter[str]
    failures: Counter[str]
    smoothed: Mapping[tuple[str, str], list[Estimate]] = field(default_factory=dict)

    def said(self, device: str, pipeline: str) -> str:
        """Return the digest of the published track."""
        return track_digest(self.published.get((device, pipeline), []))

    def settled_as(self, device: str, pipeline: str) -> str:
        """Return the digest of the settled track."""
        return track_digest(self.settled.get((device, pipeline), []))


def track_digest(estimates: Sequence[Estimate]) -> str:
    """Return the bytes of a track in short."""
    return digest(
        Track(pipeline="", device="", estimates=tuple(estimates), closed_ns=np.zeros(len(estimates), np.int64))
    )


@cache
def registry() -> Registry:
    """Return what is installed, which must be without problems."""
    found = discover()
    assert not found.problems, found.problems
    return found


def filter_names() -> list[str]:
    """Return the names of all registered filters."""
    return [offer.name for offer in registry().of_kind("filter")]


def small_lab() -> Lab:
    """Survey a small office and walk it for some ten seconds; the same every time."""
    rng = np.random.default_rng(3)
    building = office_building(rng, width_m=48.0, height_m=24.0, access_points=8)
    surveyed = [walk.recording for walk in simulate_survey(building, "F1", rng, length_m=40.0)]
    (walk,) = simulate_walks(building, "F1", np.random.default_rng(5), count=1, length_m=8.0)
    site = survey_recordings(surveyed, building.floors).site
    lines = []
    for offer in registry().of_kind("filter"):
        few = (
            ", particles = 40" if "particles" in {field.name for field in config.describe_parameters(offer.cls)} else ""
        )
        lines += [f"[pipelines.{offer.name}]", 'pdr = "steps"', 'fingerprint = "wknn"', 'map = "walls"']
        lines += [f'filter = {{ use = "{offer.name}"{few} }}']
    chosen = config.parse_config("\n".join(lines), "laws.toml", registry()).pipelines
    context = Context(floors={floor.name: floor for floor in building.floors}, radio_map=site.radio_map)
    first = walk.recording.truth[0]
    return Lab(
        pipelines={p.name: p for p in config.build_pipelines(chosen, context, {})},
        events=tuple(merged(sorted(walk.recording.events, key=lambda e: e.arrival_ns), 2)),
        start=Fix(t_ns=first.t_ns, floor=first.floor, xy=first.xy, covariance=0.25 * np.eye(2)),
    )


def fold(
    pipelines: Iterable[Pipeline],
    events: Iterable[Event],
    settings: KernelSettings = SETTINGS,
    starts: Mapping[str, Fix] = MappingProxyType({}),
    *,
    finish: bool = True,
    restarts: Collection[int] = (),
) -> Folded:
    """Feed events one by one, running the kernel after each, as a driver does.

    After the events numbered in ``restarts`` another kernel goes on from the bytes of a snapshot.
    """
    pipelines = tuple(pipelines)
    kernel = Kernel(pipelines, settings, starts=starts)
    published: dict[tuple[str, str], list[Estimate]] = {}
    settled: dict[tuple[str, str], list[Estimate]] = {}
    revised: dict[tuple[str, str], list[Estimate]] = {}
    smoothed: dict[tuple[str, str], list[Estimate]] = {}
    outcomes, outputs = [], []
    for number, event in enumerate(events):
        outcomes.append(kernel.feed(event))
        outputs.append(kernel.run(event.device))
        if number in restarts:
            data = kernel.snapshot().packed()
            kernel = Kernel(pipelines, settings, starts=starts)
            kernel.restore(KernelSnapshot.unpacked(data))
            assert kernel.snapshot().packed() == data
    if finish:
        outputs += [kernel.finish(device) for device in kernel.devices]
    for output in outputs:
        for into, estimates in (
            (published, output.published),
            (settled, output.settled),
            (revised, output.revised),
            (smoothed, output.smoothed),
        ):
            for estimate in estimates:
                into.setdefault((estimate.device, estimate.pipeline), []).append(estimate)
    return Folded(
        published, settled, revised, tuple(outcomes), kernel.intake, kernel.measurements, kernel.failures, smoothed
    )


def without_truth(events: Iterable[Event]) -> list[Event]:
    """Return what a tracker may see."""
    return [event for event in events if not isinstance(event, Truth)]


def numbered(events: Iterable[Event]) -> list[Event]:
    """Give each event its sequence number, from one, in the order given."""
    return [replace(event, seq=seq) for seq, event in enumerate(events, 1)]


def delayed(events: Sequence[Event], seed: int, longest_s: float = HORIZON_S - 0.3) -> list[Event]:
    """Return the events in another order of arrival: each up to ``longest_s`` after its newest sample."""
    delays = np.random.default_rng(seed).uniform(0.0, longest_s * 1e9, len(events))
    arrival = [event.t_ns + int(delay) for event, delay in zip(events, delays, strict=True)]
    order = sorted(range(len(events)), key=lambda i: arrival[i])
    return [replace(events[i], arrival_ns=arrival[i]) for i in order]


def split(event: Event, pieces: int, seed: int, *, in_time: bool) -> list[Event]:
    """Cut a batch of samples into several: at instants, or anyhow, sensor by sensor and in any order."""
    if not isinstance(event, MotionSamples):
        return [event]
    rng = np.random.default_rng(seed)
    cuts = sorted(rng.integers(event.t0_ns, event.t1_ns + 1, pieces - 1).tolist())
    bounds = [-(2**62), *cuts, 2**62]
    parts: list[Event] = []
    for low, high in pairwise(bounds):
        sensors = {}
        for name, samples in event.sensors.items():
            inside = (samples.t_ns > low) & (samples.t_ns <= high)
            if inside.any():
                sensors[name] = Samples(samples.t_ns[inside], samples.values[inside])
        if not sensors:
            continue
        if in_time:
            parts.append(MotionSamples(sensors=sensors, device=event.device, arrival_ns=event.arrival_ns))
        else:
            for name, samples in sensors.items():
                mixed = rng.permutation(len(samples))
                only = {name: Samples(samples.t_ns[mixed], samples.values[mixed])}
                parts.append(MotionSamples(sensors=only, device=event.device, arrival_ns=event.arrival_ns))
    if in_time:
        return parts
    return [parts[i] for i in rng.permutation(len(parts))]


def merged(events: Sequence[Event], most: int) -> list[Event]:
    """Join up to ``most`` batches of samples that follow each other without anything between them."""
    joined: list[Event] = []
    run: list[MotionSamples] = []

    def flush() -> None:
        if run:
            names = sorted({name for batch in run for name in batch.sensors})
            sensors = {}
            for name in names:
                there = [batch.sensors[name] for batch in run if name in batch.sensors]
                t_ns, values = (np.concatenate([getattr(s, part) for s in there]) for part in ("t_ns", "values"))
                sensors[name] = Samples(t_ns, values)
            joined.append(MotionSamples(sensors=sensors, device=run[0].device, arrival_ns=run[-1].arrival_ns))
            run.clear()

    for event in events:
        if isinstance(event, MotionSamples):
            run.append(event)
            if len(run) == most:
                flush()
        else:
            flush()
            joined.append(event)
    flush()
    return joined
