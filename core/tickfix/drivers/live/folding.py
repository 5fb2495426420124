"""What the loop asks of whoever folds for it: a replica in its own process, or a crew of replicas in others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import msgspec

from tickfix.api import Event, Scan
from tickfix.drivers.live.saying import Saying
from tickfix.kernel import Outcome, Standing
from tickfix.wire.decisions import Decision


@dataclass(frozen=True, slots=True)
class Feed:
    """An event enters, as the record of this number; ``body`` are its canonical bytes, where they are known."""

    number: int
    event: Event
    body: bytes | None = None


Step: TypeAlias = Feed | Decision


class Done(msgspec.Struct, frozen=True, array_like=True):
    """What came of a step.

    Attributes:
        outcome: of the event, or of the scan that a decision let in; None where there is none, or it waits.
        said: estimates in the order in which they are journaled: what was revised, then what closed a tick.
        spoke: whether a journal must have the decision: something was said, or settled.
        standing: how far the device has come; None for one that is not followed.
    """

    outcome: Outcome | None = None
    said: tuple[Saying, ...] = ()
    spoke: bool = False
    standing: Standing | None = None


@dataclass(frozen=True, slots=True)
class Books:
    """Counters: devices followed, measurements by what became of them, messages missing, failures by stage."""

    devices: int
    measurements: Mapping[str, int]
    missing: int
    failures: Mapping[str, int]


class Folding(Protocol):
    """Applies events and decisions, in their order; devices have nothing to do with each other."""

    @property
    def primary(self) -> str:
        """The pipeline that is published; empty means that none was chosen."""

    @property
    def waiting(self) -> Mapping[int, Scan]:
        """Scans that no decision has spoken of yet, by the number of their record."""

    def apply(self, steps: Sequence[Step]) -> list[Done]:
        """Do the steps in their order and return what came of each."""

    def repeats(self, event: Event) -> bool:
        """Tell whether the event would be a duplicate by its number, without taking note of it."""

    def standings(self) -> Mapping[str, Standing]:
        """Return how far each device has come."""

    def books(self) -> Books:
        """Return the counters as they are now."""

    def snapshot(self) -> bytes:
        """Return all of it as bytes; every device must have been run since it was fed."""

    def restore(self, data: bytes) -> None:
        """Become what the bytes say.

        Raises:
            ValueError: when they are no snapshot, or one of a run with other settings.
        """
