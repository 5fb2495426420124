"""Steps of many devices as one batch.

A device is folded by a coroutine. At a filter step it yields a :class:`StepRequest`, at a step of a pdr or fingerprint
that has ``step_many`` an :class:`InputRequest`; it is resumed with the result. ``step_one`` computes every step by
itself; ``step_batch`` runs the coroutines of many devices side by side and passes the requests of one stage to its
``step_many``, whose contract is to return the same bits. So batching changes what a tick costs, never its result.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

from tickfix.api.algorithms import BatchFilter, BatchFingerprint, BatchPdr
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
class InputRequest:
    """A step of a pdr or a fingerprint that a device waits for; the stage has ``step_many``.

    It is answered with what ``check`` returns, or with a :class:`StageFailure`.

    Attributes:
        stage: the pdr or the fingerprint.
        state: what it steps from.
        given: returns the samples or the window; it may raise what the stage's code raises.
        check: returns the pair that the stage returned, checked.
    """

    stage: Stage
    state: Any
    given: Callable[[], Any]
    check: Callable[[Any], tuple[Any, Any]]


@dataclass(frozen=True, slots=True, eq=False)
class StepResult:
    """What a filter step made: all of it, or else there is a :class:`StageFailure` instead."""

    state: Any
    report: Report
    belief: Belief


StepAnswer: TypeAlias = StepResult | StageFailure
StepCoroutine: TypeAlias = Generator[StepRequest | InputRequest, Any, T]
"""Work that asks for steps on its way to a result; it is sent the answer that each kind of request names."""


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
    """Run coroutines of different devices side by side; requests to one stage are computed as one batch.

    A coroutine that raises has the exception as its result; the others go on.
    """
    results: list[Any] = [None] * len(coroutines)
    # A work begins by being sent None.
    answers: list[tuple[int, Any]] = [(n, None) for n in range(len(coroutines))]
    steps: dict[str, list[tuple[int, StepRequest | InputRequest]]] = {}
    inputs: dict[str, list[tuple[int, StepRequest | InputRequest]]] = {}
    while answers:
        for n, answer in answers:
            try:
                request = coroutines[n].send(answer)
            except StopIteration as done:
                results[n] = done.value
            except Exception as error:  # noqa: BLE001 - it is that work's result; who asked for it decides
                results[n] = error
            else:
                pending = steps if isinstance(request, StepRequest) else inputs
                pending.setdefault(request.stage.key, []).append((n, request))
        answers = []
        # Only some devices have a scan in a tick. Filter steps of the others wait until the fingerprints are done, or
        # the devices would come to their filters one after the other, in small batches.
        due = inputs or steps
        for batch in due.values():
            step_output = compute_steps([request for _, request in batch], call)
            answers += [(n, answer) for (n, _), answer in zip(batch, step_output, strict=True)]
        due.clear()
    return results


def compute_step(request: StepRequest | InputRequest, call: StageCaller) -> Any:
    """Compute one step, and for a filter the belief after it; return the answer to the request."""
    stage, algorithm = request.stage, request.stage.algorithm
    if isinstance(request, InputRequest):
        return call(stage, request.check, lambda: algorithm.step(request.state, request.given()))
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


def compute_steps(batch: Sequence[StepRequest | InputRequest], call: StageCaller) -> list[Any]:
    """Compute steps of one stage on different devices, in one call if it has ``step_many``."""
    stage = batch[0].stage
    answers = None
    if len(batch) > 1 and hasattr(stage.algorithm, "step_many"):
        answers = call.call_or_none(stage, lambda: _compute_batch(batch, stage, call))
    # Stepped one by one, only the device at fault fails.
    return [compute_step(request, call) for request in batch] if answers is None else answers


def _compute_batch(batch: Sequence[StepRequest | InputRequest], stage: Stage, call: StageCaller) -> list[Any]:
    # All requests to one stage are of one class: its kind decides which.
    inputs = [request for request in batch if isinstance(request, InputRequest)]
    if inputs:
        return _compute_inputs(inputs, stage)
    return _compute_filter_steps([request for request in batch if isinstance(request, StepRequest)], stage, call)


def _compute_inputs(batch: Sequence[InputRequest], stage: Stage) -> list[tuple[Any, Any]]:
    algorithm: BatchPdr | BatchFingerprint = stage.algorithm
    step_output = algorithm.step_many([request.state for request in batch], [request.given() for request in batch])
    return [request.check(one) for request, one in zip(batch, step_output, strict=True)]


def _compute_filter_steps(batch: Sequence[StepRequest], stage: Stage, call: StageCaller) -> list[StepAnswer]:
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
