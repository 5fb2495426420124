"""Filter steps of many devices as one batch.

A device is folded by a coroutine that yields a :class:`StepRequest` where it comes to a filter step and is resumed with
the result. ``step_one`` computes every step by itself; ``step_batch`` runs the coroutines of many devices side by side
and
hands the requests of one stage to its ``step_many``, whose contract is to give the same bits; so batching changes what
a
tick costs, never its result."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

from tickfix.api.algorithms import BatchFilter
from tickfix.api.values import Belief, Motion, Observation, Report
from tickfix.kernel.stages import Stage, StageCaller, StageFailure, checked_belief, checked_report

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class StepRequest:
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
class StepResult:
    """What a filter step made: all of it, or else there is a :class:`StageFailure` instead."""

    state: Any
    report: Report
    belief: Belief


StepAnswer: TypeAlias = StepResult | StageFailure
StepCoroutine: TypeAlias = Generator[StepRequest, StepAnswer, T]
"""Work that asks for filter steps on its way to a result."""


def step_one(coroutine: StepCoroutine[T], call: StageCaller) -> T:
    """Do the work, every step by itself."""
    try:
        request = next(coroutine)
        while True:
            request = coroutine.send(compute_step(request, call))
    except StopIteration as done:
        result: T = done.value
        return result


def step_batch(coroutines: Sequence[StepCoroutine[T]], call: StageCaller) -> list[T | Exception]:
    """Do works of different devices side by side, and what they ask for at once as one batch for each filter.

    A work that raises ends with what it raised, and the others go on.
    """
    results: list[Any] = [None] * len(coroutines)
    # A work begins by being sent None.
    answers: list[tuple[int, Any]] = [(n, None) for n in range(len(coroutines))]
    while answers:
        requests: dict[str, list[tuple[int, StepRequest]]] = {}
        for n, answer in answers:
            try:
                request = coroutines[n].send(answer)
            except StopIteration as done:
                results[n] = done.value
            except Exception as error:  # noqa: BLE001 - it is that work's result; who asked for it decides
                results[n] = error
            else:
                requests.setdefault(request.stage.key, []).append((n, request))
        answers = []
        for batch in requests.values():
            step_output = compute_steps([request for _, request in batch], call)
            answers += [(n, answer) for (n, _), answer in zip(batch, step_output, strict=True)]
    return results


def compute_step(request: StepRequest, call: StageCaller) -> StepAnswer:
    """Compute one step, and the belief after it."""
    stage, algorithm = request.stage, request.stage.algorithm
    arguments = (request.state, request.motion, request.observations, request.rng())
    result = call(stage, lambda step_output: _checked_step(step_output, stage, call), algorithm.step, *arguments)
    if isinstance(result, StageFailure):
        return result
    state, report = result
    return with_estimate(stage, state, report, call)


def with_estimate(stage: Stage, state: Any, report: Report, call: StageCaller) -> StepAnswer:
    """Return a state together with what the filter believes in it."""
    belief = call(stage, checked_belief, stage.algorithm.estimate, state)
    return belief if isinstance(belief, StageFailure) else StepResult(state, report, belief)


def compute_steps(batch: Sequence[StepRequest], call: StageCaller) -> list[StepAnswer]:
    """Compute steps of one stage, on different devices: at once where its filter can."""
    stage = batch[0].stage
    answers = None
    if len(batch) > 1 and hasattr(stage.algorithm, "step_many"):
        answers = call.call_or_none(stage, lambda: _compute_batch(batch, stage, call))
    # One by one it shows whose step it was, and only that one fails.
    return [compute_step(request, call) for request in batch] if answers is None else answers


def _compute_batch(batch: Sequence[StepRequest], stage: Stage, call: StageCaller) -> list[StepAnswer]:
    algorithm: BatchFilter = stage.algorithm
    step_output = algorithm.step_many(
        [request.state for request in batch],
        [request.motion for request in batch],
        [request.observations for request in batch],
        [request.rng() for request in batch],
    )
    checked = [_checked_step(one, stage, call) for one in step_output]
    beliefs = algorithm.estimate_many([state for state, _ in checked])
    return [
        StepResult(state, report, checked_belief(belief))
        for _, (state, report), belief in zip(batch, checked, beliefs, strict=True)
    ]


def _checked_step(step_output: Any, stage: Stage, call: StageCaller) -> tuple[Any, Report]:
    state, report = step_output
    return call.state(stage, state), checked_report(report)
