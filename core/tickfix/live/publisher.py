"""From a closed tick to the listeners.

The write-ahead buffer, the queue of publications and acknowledgements that waits for its commit, and the publisher that
fills both. Nothing is published or acknowledged before it is committed.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import Final

from tickfix.api import TICK_NS, Event
from tickfix.journal import JournalFull, JournalOutOfDescriptors, JournalWriter, RecordKind
from tickfix.live.live_comparison import LiveComparison
from tickfix.live.metrics import DurationHistogram
from tickfix.live.protocol import EncodedEstimate, Executor
from tickfix.live.serve_options import LiveSettings
from tickfix.ports import Clock, Hub, InboundMessage, Publication
from tickfix.wire import ReplyOutcome, TopicFamily
from tickfix.wire.engine_messages import Decision, encode_decision

_LOGGER = logging.getLogger(__name__)

_RETRY_ROUNDS: Final = 200
"""Rounds until a segment that could not be begun is tried again."""


class WriteAheadBuffer:
    """Numbers and buffers events, decisions and estimates until :meth:`commit` writes them to the journal.

    Args:
        journal: None keeps nothing, and only numbers.
        hub: through which others follow.

    Attributes:
        problem: why a new segment that is due could not be begun; empty when all is well.
    """

    def __init__(self, journal: JournalWriter | None, hub: Hub) -> None:
        """Begin where the journal does."""
        self._journal = journal
        self._hub = hub
        self._number = 0
        self._follow_records: list[tuple[bytes, int, bytes]] = []
        self._deferred_rounds = 0
        self.problem = ""

    def event(self, event: Event, body: bytes) -> int:
        """Append an event, whose canonical bytes are ``body``, and return its number."""
        number = self._append(RecordKind.EVENT, event.device, event.t_ns, body)
        self._follow_records.append((b"event", number, body))
        return number

    def decision(self, decision: Decision, device: str, t_ns: int) -> None:
        """Append a decision about a device; ``t_ns`` is on the device's clock."""
        payload = encode_decision(decision)
        number = self._append(RecordKind.DECISION, device, t_ns, payload)
        self._follow_records.append((b"decision", number, payload))

    def estimate(self, encoded: EncodedEstimate) -> None:
        """Append an estimate or a revision."""
        kind = RecordKind.REVISION if encoded.revision else RecordKind.ESTIMATE
        self._append(kind, encoded.device, encoded.t_ns, encoded.body)

    def commit(self) -> int:
        """Write what was appended, so that it survives this process; offer it to followers; return the last number.

        Raises:
            JournalFull: when there is no room; what was appended waits for the next commit.
            JournalError: when the journal cannot be written.
        """
        if self._journal is not None:
            self._journal.commit()
        follow_records, self._follow_records = self._follow_records, []
        if follow_records:
            self._hub.follow(follow_records)
        return self._number

    def rotate_segment(self, snapshot: Callable[[], bytes]) -> None:
        """Begin a new segment where the journal wants one; without a snapshot the old one goes on.

        Raises:
            JournalFull, JournalError: when the new segment cannot be written.
        """
        if self._journal is None or not self._journal.should_roll_segment():
            return
        if self._deferred_rounds > 0:
            self._deferred_rounds -= 1
            return
        try:
            kept = snapshot()
        except Exception as error:  # noqa: BLE001 - the loop must not end for want of a shorter way to resume
            self._deferred_rounds = _RETRY_ROUNDS
            self.problem = f"no snapshot could be made, so no new segment: {type(error).__name__}: {error}"
            return
        try:
            self._journal.roll_segment(kept)
        except JournalOutOfDescriptors as error:
            # Connections have taken all file descriptors; what is open goes on until they are gone.
            self._deferred_rounds = _RETRY_ROUNDS
            self.problem = str(error)
            return
        self.problem = ""

    def when_durable(self, number: int, then: Callable[[], None]) -> None:
        """Have ``then`` called once every record up to ``number`` is on the disk; at once without a journal."""
        if self._journal is None:
            then()
        else:
            self._journal.when_durable(number, then)

    @property
    def has_uncommitted(self) -> bool:
        """Whether anything was appended since the last commit."""
        return bool(self._follow_records) or (self._journal is not None and self._journal.pending > 0)

    def status(self) -> dict[str, int | str]:
        """Return what an operator wants to know of the journal; empty without one."""
        if self._journal is None:
            return {}
        return {
            "segment": str(self._journal.path),
            "records": self._journal.next_number - 1,
            "durable": self._journal.durable,
            "pending": self._journal.pending,
            **({"problem": self.problem} if self.problem else {}),
        }

    def close(self) -> None:
        """Commit and close the journal."""
        if self._journal is not None:
            self._journal.close()

    def _append(self, kind: RecordKind, device: str, t_ns: int, payload: bytes) -> int:
        if self._journal is None:
            self._number += 1
        else:
            self._number = self._journal.append(kind, device, t_ns, payload)
        return self._number


_RETRY_NS: Final = 1_000_000_000


class PublishQueue:
    """Publishes and acknowledges after each commit; when the disk is full it waits, and nothing new is let in.

    Args:
        ack_on_disk: acknowledgements wait for the disk, not only for the commit.
    """

    def __init__(self, hub: Hub, write_ahead: WriteAheadBuffer, *, ack_on_disk: bool) -> None:
        """Begin with nothing to say."""
        self._hub = hub
        self._write_ahead = write_ahead
        self._on_disk = ack_on_disk
        self._publications: list[Publication] = []
        self._answers: list[tuple[InboundMessage, ReplyOutcome, str]] = []
        self._attempted_ns = 0
        self.journal_full = ""

    def publish(self, publications: Publication) -> None:
        """Publish this after the next commit."""
        self._publications.append(publications)

    def answer(self, item: InboundMessage, outcome: ReplyOutcome, detail: str = "") -> None:
        """Acknowledge this after the next commit."""
        self._answers.append((item, outcome, detail))

    def flush(self, snapshot: Callable[[], bytes], now_ns: int) -> None:
        """Commit, then publish and acknowledge what waits.

        Args:
            snapshot: makes the first record of a new segment, where the journal wants one.
            now_ns: monotonic.

        Raises:
            JournalError: when the journal cannot be written for another reason than a full disk.
        """
        if self.journal_full and now_ns - self._attempted_ns < _RETRY_NS:
            return
        self._attempted_ns = now_ns
        try:
            number = self._write_ahead.commit()
            self._write_ahead.rotate_segment(snapshot)
        except JournalFull as error:
            if not self.journal_full:
                _LOGGER.error(  # noqa: TRY400 - an expected state, which the message explains
                    "%s. Intake has stopped; it goes on by itself when there is room.",
                    error,
                    extra={"code": "journal_full"},
                )
            self.journal_full = f"the journal is full: {error}"
            self._hub.reject_all_messages(self.journal_full)
            return
        if self.journal_full:
            self.journal_full = ""
            self._hub.reject_all_messages(None)
            _LOGGER.info("there is room for the journal again: intake goes on", extra={"code": "journal_has_room"})
        publications, self._publications = self._publications, []
        answers, self._answers = self._answers, []
        if publications:
            self._hub.publish(publications)
        if answers and self._on_disk:
            self._write_ahead.when_durable(number, lambda: self._acknowledge(answers))
        elif answers:
            self._acknowledge(answers)

    def _acknowledge(self, answers: Sequence[tuple[InboundMessage, ReplyOutcome, str]]) -> None:
        for item, outcome, detail in answers:
            self._hub.answer(item, outcome, detail)


class EstimatePublisher:
    """Writes down estimates and decides which of them are published.

    Args:
        replica: knows which pipeline is the primary one.
        write_ahead, publish_queue: where estimates are kept, and wait to be published.
        settings: what is published.
        site: its name.
        names: of the pipelines, in their order.
        clock: monotonic.

    Attributes:
        ticks: closed by the primary pipeline.
        suppressed: estimates that the overrun policy did not publish.
        comparison: of all pipelines against the one that was primary at first.
        latency: of a tick's estimate behind the instant at which the tick could close.
    """

    def __init__(
        self,
        replica: Executor,
        write_ahead: WriteAheadBuffer,
        publish_queue: PublishQueue,
        settings: LiveSettings,
        *,
        site: str,
        names: Sequence[str],
        clock: Clock,
    ) -> None:
        """Begin with nothing published."""
        self._replica = replica
        self._write_ahead = write_ahead
        self._publish_queue = publish_queue
        self._settings = settings
        self._site = site
        self._names = tuple(names)
        self._clock = clock
        self.ticks = 0
        self.suppressed = 0
        self.latency = DurationHistogram()
        self.comparison = LiveComparison(self._names, self.primary)

    @property
    def primary(self) -> str:
        """The pipeline that is published; the last one where the chosen one is left out."""
        chosen = self._replica.primary or self._settings.primary
        return chosen if chosen in self._names else self._names[-1]

    def publish(self, estimates: Sequence[EncodedEstimate], due_ns: int | None) -> None:
        """Journal estimates; those to be published wait for the commit.

        Args:
            estimates: in a run of the kernel for one device, revisions first.
            due_ns: monotonic time at which they could be computed at the earliest; None if no latency is measured.
        """
        now_ns, primary, all_pipelines = self._clock.monotonic_ns(), self.primary, self._settings.publish == "all"
        overrun = due_ns is not None and now_ns - due_ns > TICK_NS and self._settings.overrun == "newest"
        published = [estimate for estimate in estimates if not estimate.revision]
        newest = published[-1].tick if published else None
        self.comparison.estimates(published)
        for estimate in estimates:
            self._write_ahead.estimate(estimate)
            if estimate.revision == 0 and estimate.pipeline == primary:
                self.ticks += 1
                if due_ns is not None:
                    self.latency.add((now_ns - due_ns) * 1e-6)
            if not all_pipelines and estimate.pipeline != primary:
                continue
            if estimate.revision == 0 and overrun and estimate.tick != newest:
                self.suppressed += 1
                continue
            family: TopicFamily = "revision" if estimate.revision else "estimate"
            self._publish_queue.publish(
                Publication(family, self._site, estimate.floor, estimate.device, estimate.pipeline, estimate.body)
            )
