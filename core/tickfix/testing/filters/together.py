"""Many devices that a filter may be asked for at once: a mixture of all that can differ between them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any, Final

from tickfix.api import Belief, Motion, Observation, Prior, Report, Rng, pack
from tickfix.testing import world
from tickfix.testing.calls import pure, require

DEVICES: Final = 7

Stepped = tuple[Any, Report]
Given = tuple[Motion, Sequence[Observation]]


def devices(ticks: int) -> list[list[Given]]:
    """Return what each device is given, tick by tick.

    They walk elsewhere and from another moment on; one has no compass, one no motion now and then, one stands, one has
    no fixes, one several at once, and one climbs the stairs.
    """
    walks = []
    for d in range(DEVICES):
        walk = world.walk(ticks + 5 * d, shift=(0.5 * d, 0.25 * d), compass=d != 1, fixes=d != 4)
        walks.append([_given(d, tick) for tick in list(walk)[-ticks:]])
    return walks


def _given(d: int, tick: world.Tick) -> Given:
    motion, observations = tick.motion, tick.observations
    t_ns = motion.t1_ns
    if d == 2 and tick.number % 3 == 0:
        motion = Motion.unknown(motion.t0_ns, t_ns)
    if d == 3:
        motion = Motion(t0_ns=motion.t0_ns, t1_ns=t_ns, heading_rad=0.0, stationary=True)
    if d == 5 and tick.number % 4 == 0:
        observations = tuple(world.observation(tick.xy + n, t_ns) for n in range(3))
    if d == 6 and tick.number % 3 == 0:
        observations = (world.observation(tick.xy, t_ns, "F2"),)
    return motion, observations


def groupings() -> Iterator[tuple[str, list[list[int]]]]:
    """Yield ways in which the devices may be asked for, and what to call each."""
    every = list(range(DEVICES))
    yield "all at once", [every]
    yield "all at once, in another order", [every[::-1]]
    yield "each in a batch of its own", [[d] for d in every]
    yield "in batches of three", [every[4:], every[1:4], every[:1]]


def check_many(algorithm: Any, ticks: int) -> None:
    """Fail unless ``step_many`` and ``estimate_many`` say what ``step`` and ``estimate`` say, to the bit."""
    walks = devices(ticks)
    fixes = [world.first_fix((0.5 * d, 0.25 * d)) for d in range(DEVICES)]
    states = [algorithm.start(Prior(t_ns=fix.t_ns, fix=fix), _rng(d, 0)) for d, fix in enumerate(fixes)]
    for k in range(ticks):
        given = [walk[k] for walk in walks]
        before = [pack(state) for state in states]
        alone = [algorithm.step(states[d], *given[d], _rng(d, k + 1)) for d in range(DEVICES)]
        believed = [algorithm.estimate(state) for state, _ in alone]
        for how, groups in groupings():
            for group in groups:
                stepped = _stepped(algorithm, [states[d] for d in group], [given[d] for d in group], group, k)
                beliefs = _believed(algorithm, [state for state, _ in stepped])
                for d, (state, report), belief in zip(group, stepped, beliefs, strict=True):
                    where = f"of device {d} of {DEVICES}, asked for {how}, at tick {k + 1}"
                    _same("step_many", "state", state, alone[d][0], where)
                    _same("step_many", "report", report, alone[d][1], where)
                    _same("estimate_many", "belief", belief, believed[d], where)
        unchanged = [pack(state) for state in states] == before
        require(unchanged, "step_many changed a state it was given. Write into copies, return new states")
        states = [state for state, _ in alone]


def _rng(d: int, k: int) -> Rng:
    return world.rng(11, d, k)


def _stepped(
    algorithm: Any, states: Sequence[Any], given: Sequence[Given], group: Sequence[int], k: int
) -> Sequence[Stepped]:
    motions, observations = [motion for motion, _ in given], [seen for _, seen in given]
    with pure(f"step_many at tick {k + 1}"):
        stepped: Sequence[Stepped] = algorithm.step_many(states, motions, observations, [_rng(d, k + 1) for d in group])
    found = f"step_many of {len(group)} devices returned {len(stepped)} results"
    require(len(stepped) == len(group), f"{found}. Return a pair (state, Report) for each, in the order given")
    return stepped


def _believed(algorithm: Any, states: Sequence[Any]) -> Sequence[Belief]:
    with pure("estimate_many"):
        beliefs: Sequence[Belief] = algorithm.estimate_many(states)
    found = f"estimate_many of {len(states)} states returned {len(beliefs)} beliefs"
    require(len(beliefs) == len(states), f"{found}. Return one for each, in the order given")
    return beliefs


def _same(method: str, what: str, found: Any, expected: Any, where: str) -> None:
    """Fail unless two values have the same bits, and say which of their fields have not."""
    if pack(found) == pack(expected):
        return
    fields = [f.name for f in dataclasses.fields(expected)] if type(found) is type(expected) else []
    differ = [name for name in fields if pack(getattr(found, name)) != pack(getattr(expected, name))]
    require(
        condition=False,
        message=f"{method} gave another {what} {where}, than {method.removesuffix('_many')} gives of it alone: "
        f"{', '.join(differ) or type(found).__name__} differs. Sum along each device's own row, never by a matrix "
        "product over devices, and let each draw from its own rng what it draws alone",
    )
