"""Replays a recording through the kernel as fast as possible, in the order of arrival, and collects published and
settled estimates.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from tickfix.api import Estimate, Event, Fix, MotionSamples, Recording, Run, Samples, StageFault, Truth
from tickfix.api.events import UNSET_NS
from tickfix.kernel import Kernel, KernelOutput, KernelSettings, MessageOutcome, Pipeline, StageFailure
from tickfix.observers import Observers

_WAYPOINT_SIGMA_M: Final = 0.5
_MAX_BATCH_NS: Final = 60_000_000_000


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ReplayResult:
    """What became of one walk.

    Attributes:
        recording: the walk.
        published: by pipeline, the estimates as they were published, with the arrival time of the event that closed
            their tick.
        settled: by pipeline, the last revision of every tick.
        fixes: by fingerprint stage, the fixes it found.
        intake: messages by outcome.
        measurements: single samples, scans and fixes by what became of them.
        failures: stage calls that failed.
    """

    recording: Recording
    published: Mapping[str, Sequence[tuple[Estimate, int]]]
    settled: Mapping[str, Sequence[Estimate]]
    fixes: Mapping[str, Sequence[Fix]]
    intake: Mapping[str, int]
    measurements: Mapping[str, int]
    failures: Mapping[str, int]


def replay_recording(
    recording: Recording,
    pipelines: Sequence[Pipeline],
    settings: KernelSettings | None = None,
    *,
    start: Fix | None = None,
    observers: Observers | None = None,
    site: str = "",
) -> ReplayResult:
    """Feed a recording to the kernel and collect its output.

    Truth is left out: no tracker ever sees it. What the reader could not use counts as ``malformed``.

    Args:
        recording: the walk; all its events speak of one device.
        pipelines: run side by side on the same events.
        settings: of the kernel.
        start: where the walk begins, if that is known.
        observers: called after each event that led to estimates; what they do changes no result.
        site: its name, for the observers.
    """
    observers = Observers() if observers is None else observers
    run = Run(id=recording.name, mode="replay", site=site, pipelines=tuple(p.name for p in pipelines))
    observers.run_started(run)
    try:
        result = _replay(recording, pipelines, settings, start, observers, run)
    except BaseException as error:
        observers.run_ended(run, f"{type(error).__name__}: {error}")
        raise
    observers.run_ended(run)
    return result


def _replay(
    recording: Recording,
    pipelines: Sequence[Pipeline],
    settings: KernelSettings | None,
    start: Fix | None,
    observers: Observers,
    run: Run,
) -> ReplayResult:
    events = sorted((e for e in recording.events if not isinstance(e, Truth)), key=lambda e: e.arrival_ns)
    device = events[0].device if events else recording.name
    faults: list[StageFault] = []

    def report_fault(failure: StageFailure) -> None:
        faults.append(StageFault(stage=failure.stage, error=failure.what, detail=failure.detail))

    kernel = Kernel(
        pipelines,
        settings,
        starts={} if start is None else {device: start},
        on_failure=report_fault if observers.wants("tickfix_faults") else None,
    )
    published: dict[str, list[tuple[Estimate, int]]] = {p.name: [] for p in pipelines}
    settled: dict[str, list[Estimate]] = {p.name: [] for p in pipelines}
    fixes: dict[str, list[Fix]] = {p.fingerprint.key: [] for p in pipelines if p.fingerprint is not None}

    def collect(output: KernelOutput, now_ns: int) -> None:
        for estimate in output.published:
            published[estimate.pipeline].append((estimate, now_ns))
        for estimate in output.settled:
            settled[estimate.pipeline].append(estimate)
        for stage, observation in output.observations:
            if observation.fix is not None:
                fixes[stage].append(observation.fix)
        if observers:
            observers.estimates(run, output.emitted)
            observers.fixes(run, [o.fix for _, o in output.observations if o.fix is not None])
            observers.faults(run, faults)
            faults.clear()

    now_ns = 0
    for event in events:
        now_ns = event.arrival_ns
        for piece in split_batch(event):
            kernel.feed(piece)
        collect(kernel.run(event.device), now_ns)
    collect(kernel.finish(device), now_ns)
    intake: Counter[str] = Counter(kernel.intake)
    intake[MessageOutcome.MALFORMED.value] += sum(recording.rejected.values())
    return ReplayResult(
        recording=recording,
        published=published,
        settled=settled,
        fixes=fixes,
        intake={outcome: count for outcome, count in sorted(intake.items()) if count},
        measurements=dict(sorted(kernel.measurements.items())),
        failures=dict(sorted(kernel.failures.items())),
    )


def split_batch(event: Event) -> Iterator[Event]:
    """Cut a batch of samples that is longer than a message may be; how samples are batched changes nothing."""
    if not isinstance(event, MotionSamples) or event.t1_ns - event.t0_ns <= _MAX_BATCH_NS:
        yield event
        return
    parts = {name: samples.t_ns // _MAX_BATCH_NS for name, samples in event.sensors.items()}
    for part in np.unique(np.concatenate(list(parts.values()))):
        within = {name: found == part for name, found in parts.items()}
        yield replace(
            event,
            sensors={
                name: Samples(samples.t_ns[within[name]], samples.values[within[name]])
                for name, samples in event.sensors.items()
                if within[name].any()
            },
            t0_ns=UNSET_NS,
            t1_ns=UNSET_NS,
            seq=0,
        )


def start_at_first_waypoint(recording: Recording) -> Fix | None:
    """Return the first waypoint as a start that is known, None for a walk without waypoints."""
    truth = recording.truth
    if not truth:
        return None
    first = truth[0]
    covariance = _WAYPOINT_SIGMA_M**2 * np.eye(2)
    return Fix(t_ns=first.t_ns, floor=first.floor, xy=first.xy, covariance=covariance, source="waypoint")
