"""A kernel that does what events and decisions say: the same live, after a crash, in a replay and in a follower."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from tickfix.api import Event, Scan
from tickfix.api.packing import pack, unpack
from tickfix.drivers.live.folding import Books, Done, Feed, Step
from tickfix.drivers.live.saying import Saying
from tickfix.kernel import Failure, Kernel, KernelSettings, KernelSnapshot, Outcome, Output, Pipeline, Stage, Standing
from tickfix.wire import decode_event, encode_event
from tickfix.wire.decisions import Decision, Drop, Finish, Fold, Primary, Run


@dataclass(frozen=True, slots=True)
class ReplicaSnapshot:
    """All of a replica.

    Attributes:
        kernel: its kernel's snapshot, packed.
        waiting: scans that no decision has spoken of yet: number and event, encoded.
        primary: the pipeline that is published; empty means the first.
    """

    kernel: bytes
    waiting: tuple[tuple[int, bytes], ...]
    primary: str


class Replica:
    """Applies events and decisions, in their order, to a kernel of its own.

    A scan only waits when it comes: a ``Fold`` decision lets it in, once it has been located beside the loop.
    """

    def __init__(
        self,
        pipelines: Sequence[Pipeline],
        settings: KernelSettings,
        *,
        on_call: Callable[[Stage | None], None] | None = None,
        on_failure: Callable[[Failure], None] | None = None,
    ) -> None:
        """Begin with nothing.

        Args:
            on_call: told of every stage before it is called, and None after.
            on_failure: told of every call that failed.
        """
        self.kernel = Kernel(pipelines, settings, on_call=on_call, on_failure=on_failure)
        self._waiting: dict[int, Scan] = {}
        self.primary = ""

    def apply(self, steps: Iterable[Step]) -> list[Done]:
        """Do the steps in their order and return what came of each; neighbouring runs are done together."""
        done: list[Done] = []
        runs: list[Run] = []
        devices: set[str] = set()
        for step in steps:
            if isinstance(step, Run) and step.device not in devices and (not runs or runs[0].most == step.most):
                runs.append(step)
                devices.add(step.device)
                continue
            done += self._run(runs)
            runs, devices = [], set()
            if isinstance(step, Run):
                runs.append(step)
                devices.add(step.device)
            elif isinstance(step, Feed):
                outcome = self.event(step.number, step.event)
                done.append(Done(outcome, standing=self.kernel.standing(step.event.device)))
            else:
                done.append(self._decided(step))
        return done + self._run(runs)

    def event(self, number: int, event: Event) -> Outcome | None:
        """Take in the event of record ``number``; None means that it waits for a decision."""
        if isinstance(event, Scan):
            self._waiting[number] = event
            return None
        return self.kernel.feed(event)

    def decide(self, decision: Decision) -> tuple[Output, Outcome | None]:
        """Do what was decided; return what the kernel says to it, and what became of a scan that it spoke of."""
        if isinstance(decision, Run):
            return self.kernel.run(decision.device, decision.tick, decision.most), None
        if isinstance(decision, Fold):
            scan = self._waiting.pop(decision.number, None)
            return Output(), None if scan is None else self.kernel.feed(scan)
        if isinstance(decision, Finish):
            return self.kernel.finish(decision.device), None
        if isinstance(decision, Drop):
            self._waiting.pop(decision.number, None)
        elif isinstance(decision, Primary):
            self.primary = decision.pipeline
        return Output(), None

    def repeats(self, event: Event) -> bool:
        """Tell whether the event would be a duplicate by its number, without taking note of it."""
        return self.kernel.repeats(event)

    def standings(self) -> dict[str, Standing]:
        """Return how far each device has come."""
        standings = {device: self.kernel.standing(device) for device in self.kernel.devices}
        return {device: standing for device, standing in standings.items() if standing is not None}

    def books(self) -> Books:
        """Return the counters as they are now."""
        kernel = self.kernel
        return Books(len(kernel.devices), dict(kernel.measurements), kernel.missing, dict(kernel.failures))

    @property
    def waiting(self) -> Mapping[int, Scan]:
        """Scans that no decision has spoken of yet, by the number of their record."""
        return self._waiting

    def snapshot(self) -> bytes:
        """Return all of it as bytes; every device must have been run since it was fed."""
        waiting = tuple((number, encode_event(scan)) for number, scan in self._waiting.items())
        return pack(ReplicaSnapshot(self.kernel.snapshot().packed(), waiting, self.primary))

    def restore(self, data: bytes) -> None:
        """Become what the bytes say.

        Raises:
            ValueError: when they are no snapshot, or one of a run with other settings.
        """
        kept = unpack(data, ReplicaSnapshot)
        self.kernel.restore(KernelSnapshot.unpacked(kept.kernel))
        self.primary = kept.primary
        for number, encoded in kept.waiting:
            event = decode_event(encoded)
            if isinstance(event, Scan):
                self._waiting[number] = event

    def _run(self, runs: Sequence[Run]) -> list[Done]:
        if not runs:
            return []
        outputs = self.kernel.run_many([(run.device, run.tick) for run in runs], runs[0].most)
        return [self._said(run.device, output) for run, output in zip(runs, outputs, strict=True)]

    def _decided(self, decision: Decision) -> Done:
        scan = self._waiting.get(decision.number) if isinstance(decision, Fold) else None
        output, outcome = self.decide(decision)
        device = decision.device if isinstance(decision, Finish) else "" if scan is None else scan.device
        return self._said(device, output, outcome)

    def _said(self, device: str, output: Output, outcome: Outcome | None = None) -> Done:
        said = tuple(Saying.of(estimate) for estimate in (*output.revised, *output.published))
        return Done(outcome, said, bool(said or output.settled), self.kernel.standing(device))
