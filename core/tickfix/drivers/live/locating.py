"""Scans are located beside the loop: a tick that closes first is published without them.

What is computed here is found by the kernel when it asks: see :mod:`tickfix.drivers.live.remembering`.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

from tickfix.api import Scan
from tickfix.kernel import Question


@dataclass(frozen=True, slots=True)
class Located:
    """A scan whose questions are answered, or given up; ``reason`` is empty unless it was given up."""

    number: int
    device: str
    reason: str = ""


@dataclass(slots=True, eq=False)
class _Job:
    number: int
    device: str
    questions: Sequence[Question]
    asked_ns: int
    begun_ns: int | None = None
    given_up: bool = False
    replaced: bool = False


class Locator:
    """Answers questions in threads of its own.

    A thread that hangs in one is left behind, and another takes its place, a few times; after that scans are given up
    until one comes back.

    Args:
        questions: returns what the fingerprints will be asked once a scan is fed; called where :meth:`ask` is.
        wake: called, from any thread, when something is done.
        threads: that work at once.
        timeout_s: for one scan; after that it is given up.
        clock_ns: monotonic.
    """

    def __init__(
        self,
        questions: Callable[[Scan], Sequence[Question]],
        wake: Callable[[], None],
        *,
        threads: int = 1,
        timeout_s: float = 5.0,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """Start the threads."""
        self._questions = questions
        self._wake = wake
        self._timeout_ns = round(timeout_s * 1e9)
        self._clock_ns = clock_ns
        self._most = threads * 4
        self._condition = threading.Condition()
        self._queue: deque[_Job] = deque()
        self._working: list[_Job] = []
        self._done: list[Located] = []
        self._stopped = False
        self._alive = 0
        self.hung = 0
        for _ in range(threads):
            self._spawn()

    def ask(self, number: int, scan: Scan) -> None:
        """Answer the questions that the scan of record ``number`` raises."""
        questions = self._questions(scan)
        with self._condition:
            self._queue.append(_Job(number, scan.device, questions, self._clock_ns()))
            self._condition.notify()

    def done(self) -> list[Located]:
        """Return what was answered or given up since the last call."""
        with self._condition:
            self._give_up()
            done, self._done = self._done, []
        return done

    @property
    def waiting(self) -> int:
        """How many scans are neither answered nor given up."""
        with self._condition:
            return len(self._queue) + sum(not job.given_up for job in self._working)

    def stop(self) -> None:
        """Let the threads end; those that hang are daemons and die with the process."""
        with self._condition:
            self._stopped = True
            self._condition.notify_all()

    def _give_up(self) -> None:
        now_ns = self._clock_ns()
        for job in self._working:
            if job.begun_ns is not None and not job.given_up and now_ns - job.begun_ns > self._timeout_ns:
                job.given_up = True
                self.hung += 1
                self._done.append(Located(job.number, job.device, "not located in time"))
                job.replaced = self._alive < self._most
                if job.replaced:
                    self._spawn()
        # Nobody is left to work: what has waited for as long is given up too.
        while self._queue and now_ns - self._queue[0].asked_ns > 2 * self._timeout_ns:
            job = self._queue.popleft()
            self._done.append(Located(job.number, job.device, "not located in time"))

    def _spawn(self) -> None:
        self._alive += 1
        threading.Thread(target=self._work, name="tickfix-locator", daemon=True).start()

    def _work(self) -> None:
        while True:
            with self._condition:
                while not self._queue and not self._stopped:
                    self._condition.wait()
                if self._stopped:
                    return
                job = self._queue.popleft()
                job.begun_ns = self._clock_ns()
                self._working.append(job)
            for question in job.questions:
                _answer(question)
            with self._condition:
                self._working.remove(job)
                if job.replaced:
                    self._alive -= 1
                    return
                if job.given_up:
                    continue
                self._done.append(Located(job.number, job.device))
            self._wake()


def _answer(question: Question) -> None:
    """Compute the answers; they are remembered, and what is raised is raised again where the kernel asks."""
    state = question.state
    for window in question.windows:
        with suppress(Exception):
            state, _ = question.stage.algorithm.step(state, window)
