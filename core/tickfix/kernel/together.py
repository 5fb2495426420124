"""Filter steps of many devices as one batch.

A device folds as if it were alone. Where it comes to a filter step it stops and asks for it; whoever runs the device
answers. Run alone, every step is computed by itself. Run together, those of one stage are handed to its ``step_many``,
whose law is to give the same bits; so batching changes what a tick costs, never what it says.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

from tickfix.api.algorithms import FilterOfMany
from tickfix.api.values import Belief, Motion, Observation, Report
from tickfix.kernel.stages import Caller, Failure, Stage, checked_belief, checked_report

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class Asked:
    """A filter step that a device waits for.

    Attributes:
        stage: the filter.
        state, motion, observations: what it steps from, and what happened in the tick.
        rng: returns the step's generator at its beginning; it is the device's, and serves one step at a time.
    """

    stage: Stage
    state: Any
    motion: Motion
    observations: Sequence[Observation]
    rng: Callable[[], Any]


@dataclass(frozen=True, slots=True, eq=False)
class Stepped:
    """What a filter step made: all of it, or else there is a :class:`Failure` instead."""

    state: Any
    report: Report
    belief: Belief


Answer: TypeAlias = Stepped | Failure
Asking: TypeAlias = Generator[Asked, Answer, T]
"""Work that asks for filter steps on its way to a result."""


def alone(work: Asking[T], call: Caller) -> T:
    """Do the work, every step by itself."""
    try:
        asked = next(work)
        while True:
            asked = work.send(step(asked, call))
    except StopIteration as done:
        result: T = done.value
        return result


def together(works: Sequence[Asking[T]], call: Caller) -> list[T | Exception]:
    """Do works of different devices side by side, and what they ask for at once as one batch for each filter.

    A work that raises ends with what it raised, and the others go on.
    """
    results: list[Any] = [None] * len(works)
    # A work begins by being sent None.
    answers: list[tuple[int, Any]] = [(n, None) for n in range(len(works))]
    while answers:
        asking: dict[str, list[tuple[int, Asked]]] = {}
        for n, answer in answers:
            try:
                asked = works[n].send(answer)
            except StopIteration as done:
                results[n] = done.value
            except Exception as error:  # noqa: BLE001 - it is that work's result; who asked for it decides
                results[n] = error
            else:
                asking.setdefault(asked.stage.key, []).append((n, asked))
        answers = []
        for batch in asking.values():
            stepped = step_all([asked for _, asked in batch], call)
            answers += [(n, answer) for (n, _), answer in zip(batch, stepped, strict=True)]
    return results


def step(asked: Asked, call: Caller) -> Answer:
    """Compute one step, and the belief after it."""
    stage, algorithm = asked.stage, asked.stage.algorithm
    arguments = (asked.state, asked.motion, asked.observations, asked.rng())
    result = call(stage, lambda stepped: _checked(stepped, stage, call), algorithm.step, *arguments)
    if isinstance(result, Failure):
        return result
    state, report = result
    return seen(stage, state, report, call)


def seen(stage: Stage, state: Any, report: Report, call: Caller) -> Answer:
    """Return a state together with what the filter believes in it."""
    belief = call(stage, checked_belief, stage.algorithm.estimate, state)
    return belief if isinstance(belief, Failure) else Stepped(state, report, belief)


def step_all(batch: Sequence[Asked], call: Caller) -> list[Answer]:
    """Compute steps of one stage, on different devices: at once where its filter can."""
    stage = batch[0].stage
    answers = None
    if len(batch) > 1 and hasattr(stage.algorithm, "step_many"):
        answers = call.attempt(stage, lambda: _at_once(batch, stage, call))
    # One by one it shows whose step it was, and only that one fails.
    return [step(asked, call) for asked in batch] if answers is None else answers


def _at_once(batch: Sequence[Asked], stage: Stage, call: Caller) -> list[Answer]:
    algorithm: FilterOfMany = stage.algorithm
    stepped = algorithm.step_many(
        [asked.state for asked in batch],
        [asked.motion for asked in batch],
        [asked.observations for asked in batch],
        [asked.rng() for asked in batch],
    )
    checked = [_checked(one, stage, call) for one in stepped]
    beliefs = algorithm.estimate_many([state for state, _ in checked])
    return [
        Stepped(state, report, checked_belief(belief))
        for _, (state, report), belief in zip(batch, checked, beliefs, strict=True)
    ]


def _checked(stepped: Any, stage: Stage, call: Caller) -> tuple[Any, Report]:
    state, report = stepped
    return call.state(stage, state), checked_report(report)
