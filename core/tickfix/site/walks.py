"""Recordings as algorithms that learn see them: all motion of a walk in one value, scans and truth beside it."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from tickfix.api import Floats, Ints, MotionSamples, Pressure, Recording, Samples, Scan, SurveyWalk


def survey_walk(recording: Recording, chain: str) -> SurveyWalk:
    """Return the walk with its motion merged and its scans in time order."""
    truth = recording.truth
    return SurveyWalk(
        name=recording.name,
        chain=chain,
        floor=recording.floor or truth[0].floor,
        truth=truth,
        motion=merged_motion(recording),
        scans=tuple(sorted((e for e in recording.events if isinstance(e, Scan)), key=lambda e: (e.t_ns, e.source))),
    )


def merged_motion(recording: Recording) -> MotionSamples:
    """Return all motion samples and pressures in one value, each sensor's times strictly increasing.

    Of samples of a sensor at the same instant the one logged first counts.
    """
    parts: defaultdict[str, list[tuple[Ints, Floats]]] = defaultdict(list)
    for event in recording.events:
        if isinstance(event, MotionSamples):
            for sensor, samples in event.sensors.items():
                parts[sensor].append((samples.t_ns, samples.values))
        elif isinstance(event, Pressure):
            parts["pressure"].append((np.array([event.t_ns]), np.array([[event.pressure_hpa]])))
    sensors: dict[str, Samples] = {}
    for sensor in sorted(parts):
        times, first = np.unique(np.concatenate([t_ns for t_ns, _ in parts[sensor]]), return_index=True)
        sensors[sensor] = Samples(times, np.concatenate([values for _, values in parts[sensor]])[first])
    return MotionSamples(sensors=sensors, device=recording.name, session=recording.name)
