"""The crew: for the loop a replica like any other; within, every device is folded by the worker that it belongs to."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection
from typing import Final

from tickfix.api import Event, Scan
from tickfix.drivers.live.crew.member import Member
from tickfix.drivers.live.crew.messages import (
    DONE,
    LOADED,
    SAVED,
    TALLIES,
    Apply,
    Count,
    Entry,
    Forget,
    Leave,
    Load,
    Save,
    Tally,
    encode,
    entry_of,
)
from tickfix.drivers.live.crew.notices import Notices
from tickfix.drivers.live.crew.roll import Roll, owner
from tickfix.drivers.live.crew.snapshots import merged, split, summed
from tickfix.drivers.live.errors import WorkerError
from tickfix.drivers.live.folding import Books, Done, Step
from tickfix.kernel import Standing
from tickfix.wire.decisions import Drop

_COUNT: Final = encode(Count())
_SAVE: Final = encode(Save())


class Crew:
    """Worker processes, each with the devices that are its own.

    What is asked of several workers is sent to all of them before the first answer is awaited: it takes as long as the
    slowest of them.

    Args:
        workers: how many.
        work: is worker number n, in a process of its own: see :class:`Member`. Processes are forked, so there should be
            no other thread yet.
    """

    def __init__(self, workers: int, work: Callable[[int, Connection, Connection], None]) -> None:
        """Start the workers."""
        self._members: list[Member] = []
        for n in range(workers):
            self._members.append(Member(n, partial(work, n), self._members))
        self._roll = Roll()
        self._standings: dict[str, Standing] = {}
        self._forgotten: list[str] = []
        self._tallies = [Tally({}, 0, {})] * workers
        self._uncounted: set[int] = set()
        self._notices: Notices | None = None

    @property
    def primary(self) -> str:
        """The pipeline that is published; empty means that none was chosen."""
        return self._roll.primary

    @property
    def waiting(self) -> Mapping[int, Scan]:
        """Scans that no decision has spoken of yet, by the number of their record."""
        return self._roll.waiting

    def apply(self, steps: Sequence[Step]) -> list[Done]:
        """Do the steps in their order and return what came of each.

        Raises:
            WorkerError: when a worker is gone.
        """
        if self._notices is not None:
            self._notices.check()
        entries: list[list[Entry]] = [[] for _ in self._members]
        places: list[list[int]] = [[] for _ in self._members]
        devices: list[str | None] = []
        for gone in self._forgotten:
            entries[self._owner(gone)].append(Forget(gone))
        for place, step in enumerate(steps):
            device, forgotten = self._roll.enter(step)
            devices.append(device)
            if device is not None:
                n = self._owner(device)
                entries[n].append(entry_of(step))
                places[n].append(place)
            for gone in forgotten:
                entries[self._owner(gone)].append(Forget(gone))
        asked = {n: encode(Apply(part)) for n, part in enumerate(entries) if part}
        done = [Done()] * len(steps)
        for n, answer in self._ask(asked).items():
            for place, came in zip(places[n], DONE.decode(answer), strict=True):
                done[place] = came
        self._uncounted |= asked.keys()
        self._forgotten = self._roll.lose(self._stand(steps, devices, done))
        return done

    def repeats(self, event: Event) -> bool:
        """Tell whether the event would be a duplicate by its number, without taking note of it."""
        return self._roll.sessions.repeats(event)

    def standings(self) -> Mapping[str, Standing]:
        """Return how far each device has come."""
        return self._standings

    def books(self) -> Books:
        """Return the counters as they are now; only workers that did something since the last time are asked."""
        for n, answer in self._ask(dict.fromkeys(sorted(self._uncounted), _COUNT)).items():
            self._tallies[n] = TALLIES.decode(answer)
        self._uncounted.clear()
        return Books(
            devices=len(self._roll.followed),
            measurements=summed(tally.measurements for tally in self._tallies),
            missing=sum(tally.missing for tally in self._tallies),
            failures=summed(tally.failures for tally in self._tallies),
        )

    def snapshot(self) -> bytes:
        """Return all of it as the bytes that one replica would give; every device must have been run since it was fed.

        Raises:
            WorkerError: when a worker is gone.
        """
        answers = self._ask(dict.fromkeys(range(len(self._members)), _SAVE))
        return merged([SAVED.decode(answer) for answer in answers.values()], self._roll)

    def restore(self, data: bytes) -> None:
        """Become what the bytes say, whoever they are from.

        Raises:
            ValueError: when they are no snapshot, or one of a run with other settings.
            WorkerError: when a worker is gone.
        """
        parts = split(data, self._roll, len(self._members), self._owner)
        answers = self._ask({n: encode(Load(part)) for n, part in enumerate(parts)})
        found: dict[str, Standing] = {}
        for loaded in map(LOADED.decode, answers.values()):
            if loaded.refused:
                raise ValueError(loaded.refused)
            found |= loaded.standings
        self._standings = {device: found[device] for device in self._roll.followed}
        self._uncounted = set(answers)

    def locating(self, wake: Callable[[], None]) -> Notices:
        """Return whoever locates scans: each worker those of its devices, beside its folding.

        Args:
            wake: called, from another thread, when one is done, or a worker is gone.
        """
        self._notices = Notices(self._members, self._owner, wake)
        return self._notices

    def close(self) -> None:
        """End the workers and wait for them."""
        for member in self._members:
            with suppress(WorkerError):
                member.ask(encode(Leave()))
        for member in self._members:
            member.join()
        if self._notices is not None:
            self._notices.join()
        for member in self._members:
            member.let_go()

    def _stand(self, steps: Sequence[Step], devices: Sequence[str | None], done: Sequence[Done]) -> list[str]:
        """Take note of how far devices have come; return those on which a kernel broke: it goes on without them."""
        without: dict[str, None] = {}
        for step, device, came in zip(steps, devices, done, strict=True):
            if device is None or isinstance(step, Drop):
                continue
            if came.standing is None:
                self._standings.pop(device, None)
                without[device] = None
            else:
                self._standings[device] = came.standing
        return [device for device in without if device in self._roll.followed and device not in self._standings]

    def _owner(self, device: str) -> int:
        return owner(device, len(self._members))

    def _ask(self, requests: Mapping[int, bytes]) -> dict[int, bytes]:
        # Nobody waits for the other for ever: a worker reads all of a request before it writes, and has one at a time.
        for n, request in requests.items():
            self._members[n].ask(request)
        return {n: self._members[n].answer() for n in requests}
