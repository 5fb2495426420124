"""The check that ``step_many`` of a pdr or a fingerprint gives the same bits as one device at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from tickfix.api import Floats, MotionSamples, Observation, Readings, frozen, pack
from tickfix.testing import world
from tickfix.testing.contract import pure_call, require, require_step_pair
from tickfix.testing.filter_batches import N_DEVICES, declared_tolerance, groupings, require_same

_LIKELIHOOD_PLACES: Final = frozen([[3.0, 3.0], [18.0, 10.0], [1.0, 11.0], [10.0, 6.0]])


def sample_inputs(ticks: int) -> list[list[MotionSamples]]:
    """Return the samples of each device, tick by tick: other moments, sensors and rates; one rests, one has gaps."""
    subsets = (world.SENSORS, world.SENSORS, world.SENSORS[:1], world.SENSORS[:2], world.SENSORS[1:], (), world.SENSORS)
    walks = [
        [world.samples(k + 7 * d, subsets[d], walking=d != 1, rate_hz=(50, 100)[d % 2]) for k in range(1, ticks + 1)]
        for d in range(N_DEVICES - 1)
    ]
    walks.append([world.samples(k, world.SENSORS if k % 5 else (), rate_hz=20) for k in range(1, ticks + 1)])
    return walks


def window_inputs(scans: int) -> list[list[Readings]]:
    """Return the windows of each device: other places, floors and lengths; one hears nothing, one what is unknown."""
    floors = tuple(world.floors())
    walks = [
        [
            world.readings(
                floors[d % len(floors)],
                (3.0 + 2.0 * d, 3.0 + (n + d) % 7),
                t_ns=world.T0_NS + n * 10**9 + d,
                noise_db=3.0,
            )
            for n in range(scans)
        ]
        for d in range(N_DEVICES - 3)
    ]
    times = [world.T0_NS + n * 10**9 for n in range(scans)]
    heard = world.rssi_at("F1", frozen([10.0, 2.0]))
    few = list(heard)[:2]
    walks.append([world.make_readings(t_ns, few, [heard[name] for name in few], [0.0, 0.5]) for t_ns in times])
    walks.append([world.make_readings(t_ns, [], [], []) for t_ns in times])
    walks.append([world.make_readings(t_ns, ["unknown"], [-50.0], [0.0]) for t_ns in times])
    return walks


def check_stage_step_many(
    algorithm: Any, inputs: Sequence[Sequence[Any]], kind: type[Any], comparable: Callable[[Any], Any] = lambda out: out
) -> None:
    """Fail unless ``step_many`` returns what ``step`` returns, to the bit or within ``batch_tolerance``.

    Args:
        algorithm: a pdr or a fingerprint.
        inputs: what each of ``N_DEVICES`` devices is given, step by step.
        kind: of what ``step`` returns beside the state.
        comparable: turns that into a dataclass without functions.
    """
    tolerance = declared_tolerance(algorithm)
    states = [algorithm.start() for _ in range(N_DEVICES)]
    for k, given in enumerate(zip(*inputs, strict=True)):
        before = [pack(state) for state in states]
        alone = [require_step_pair(algorithm.step(states[d], given[d]), kind) for d in range(N_DEVICES)]
        for how, groups in groupings():
            for group in groups:
                with pure_call(f"step_many at step {k + 1}"):
                    stepped = algorithm.step_many([states[d] for d in group], [given[d] for d in group])
                found = f"step_many of {len(group)} devices returned {len(stepped)} results"
                require(len(stepped) == len(group), f"{found}. Return a pair for each, in the order given")
                for d, pair in zip(group, stepped, strict=True):
                    state, output = require_step_pair(pair, kind)
                    where = f"of device {d} of {N_DEVICES}, asked for {how}, at step {k + 1}"
                    require_same("step_many", "state", state, alone[d][0], where, tolerance)
                    what, expected = kind.__name__.lower(), comparable(alone[d][1])
                    require_same("step_many", what, comparable(output), expected, where, tolerance)
        unchanged = [pack(state) for state in states] == before
        require(unchanged, "step_many changed a state it was given. Write into copies, return new states")
        states = [state for state, _ in alone]


@dataclass(frozen=True)
class ComparableObservation:
    """An observation with values in place of its functions; without a fix ``floor`` is empty."""

    t_ns: int
    source: str
    fix_t_ns: int | None
    floor: str
    xy: Floats | None
    covariance: Floats | None
    log_likelihood: Floats | None
    sample_floors: tuple[str, ...]
    sample_xy: Floats | None


def comparable_observation(observation: Observation) -> ComparableObservation:
    """Return what two equal observations have in common, their functions evaluated."""
    fix, likelihood, sample = observation.fix, observation.log_likelihood, observation.sample
    floors, xy = ((), None) if sample is None else sample(20, world.rng(5))
    return ComparableObservation(
        t_ns=observation.t_ns,
        source=observation.source,
        fix_t_ns=None if fix is None else int(fix.t_ns),
        floor="" if fix is None else fix.floor,
        xy=None if fix is None else fix.xy,
        covariance=None if fix is None else fix.covariance,
        log_likelihood=None if likelihood is None else likelihood("F1", _LIKELIHOOD_PLACES),
        sample_floors=tuple(floors),
        sample_xy=xy,
    )
