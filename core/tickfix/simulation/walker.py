"""A person who walks a route: when they are where, and which steps take them there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tickfix.api import Floats, Rng, frozen
from tickfix.simulation.people import Walker
from tickfix.simulation.routes import Route
from tickfix.simulation.timing import Course, walk_course


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Trajectory:
    """Where the person truly was, n instants at a fixed rate.

    Attributes:
        t_s: (n,) since the recording began, evenly spaced.
        way_m: (n,) walked so far.
        xy: (n, 2) metres, floor frame.
        heading_rad: (n,) direction of walking, clockwise from +y, continuous (not wrapped).
        speed_mps: (n,).
        phase: (n,) steps walked so far, with fractions; a whole number while standing.
        swing_mps2: (n,) swing a_max − a_min of the current step, 0 while standing.
    """

    t_s: Floats
    way_m: Floats
    xy: Floats
    heading_rad: Floats
    speed_mps: Floats
    phase: Floats
    swing_mps2: Floats

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("t_s", "way_m", "xy", "heading_rad", "speed_mps", "phase", "swing_mps2"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def xy_at(self, t_s: Floats) -> Floats:
        """Return the places (…, 2) at times (…) in seconds."""
        return np.stack([np.interp(t_s, self.t_s, self.xy[:, i]) for i in range(2)], axis=-1)

    def heading_at(self, t_s: Floats) -> Floats:
        """Return the headings (…) at times (…) in seconds."""
        return np.interp(t_s, self.t_s, self.heading_rad)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Steps:
    """The true steps.

    Attributes:
        t_s: (k,) when each was completed.
        length_m: (k,) way covered by each.
        swing_mps2: (k,) a_max − a_min of the acceleration it causes.
    """

    t_s: Floats
    length_m: Floats
    swing_mps2: Floats

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("t_s", "length_m", "swing_mps2"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def __len__(self) -> int:
        """Return the number of steps."""
        return len(self.t_s)


def walk(route: Route, walker: Walker, rng: Rng, rate_hz: float = 200.0) -> tuple[Trajectory, Steps]:
    """Walk a route from its first to its last point.

    Args:
        route: the line that is walked exactly.
        walker: who walks.
        rng: draws changes of speed, pauses, and what differs from step to step.
        rate_hz: of the trajectory.
    """
    course, phases = walk_course(route.xy, walker, rng)
    ends = np.concatenate([bout[1:] for bout in phases])
    begins = np.concatenate([bout[:-1] for bout in phases])
    length = np.interp(ends, course.t_s, course.way_m) - np.interp(begins, course.t_s, course.way_m)
    # A step much shorter than usual still shakes the phone somewhat.
    swing = np.maximum((length / walker.weinberg_k) ** 4, 0.8)
    swing *= np.clip(1.0 + walker.swing_jitter * rng.standard_normal(len(swing)), 0.5, 1.5)
    steps = Steps(t_s=ends, length_m=length, swing_mps2=swing)
    return _sampled(course, phases, swing, rate_hz), steps


def _sampled(course: Course, phases: tuple[Floats, ...], swing: Floats, rate_hz: float) -> Trajectory:
    t = np.arange(int(np.ceil(course.t_s[-1] * rate_hz)) + 1) / rate_hz
    way = np.interp(t, course.t_s, course.way_m)
    phase_t, phase, envelope_t, envelope = [], [], [], []
    done = 0
    for bout in phases:
        n = len(bout) - 1
        phase_t.append(bout)
        phase.append(done + np.arange(n + 1, dtype=np.float64))
        # Full swing in the middle of each step, none before the first and after the last: no jump anywhere.
        envelope_t.append(np.concatenate([bout[:1], (bout[:-1] + bout[1:]) / 2.0, bout[-1:]]))
        envelope.append(np.concatenate([[0.0], swing[done : done + n], [0.0]]))
        done += n
    return Trajectory(
        t_s=t,
        way_m=way,
        xy=np.stack([np.interp(way, course.line_m, course.line_xy[:, i]) for i in range(2)], axis=1),
        heading_rad=np.interp(t, course.t_s, course.heading_rad),
        speed_mps=np.interp(t, course.t_s, course.speed_mps),
        phase=np.interp(t, np.concatenate(phase_t), np.concatenate(phase)),
        swing_mps2=np.interp(t, np.concatenate(envelope_t), np.concatenate(envelope)),
    )
