"""A kernel that does what events and decisions say: the same live, after a crash, in a replay and in a follower."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from tickfix.api import Event, Scan
from tickfix.api.packing import pack, unpack
from tickfix.kernel import Kernel, KernelSettings, KernelSnapshot, Outcome, Output, Pipeline, Stage
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
    ) -> None:
        """Begin with nothing; ``on_call`` is told of every stage before it is called, and None after."""
        self.kernel = Kernel(pipelines, settings, on_call=on_call)
        self._waiting: dict[int, Scan] = {}
        self.primary = ""

    def event(self, number: int, event: Event) -> Outcome | None:
        """Take in the event of record ``number``; None means that it waits for a decision."""
        if isinstance(event, Scan):
            self._waiting[number] = event
            return None
        return self.kernel.feed(event)

    def decide(self, decision: Decision) -> tuple[Output, Outcome | None]:
        """Do what was decided; return what the kernel says to it, and what became of a scan that it spoke of."""
        if isinstance(decision, Run):
            return self.kernel.run(decision.device, decision.tick), None
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
