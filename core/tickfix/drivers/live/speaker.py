"""Saying what the kernel says: every estimate is written down, those of the primary pipeline are published."""

from __future__ import annotations

from collections.abc import Sequence

from tickfix.api import TICK_NS
from tickfix.drivers.live.contest import Contest
from tickfix.drivers.live.folding import Folding
from tickfix.drivers.live.histogram import Histogram
from tickfix.drivers.live.ledger import Ledger
from tickfix.drivers.live.outbox import Outbox
from tickfix.drivers.live.saying import Saying
from tickfix.drivers.live.settings import LiveSettings
from tickfix.ports import Clock, Said
from tickfix.wire import Family


class Speaker:
    """Writes down estimates and decides which of them are published.

    Args:
        replica: knows which pipeline is the primary one.
        ledger, outbox: where estimates are kept, and wait to be published.
        settings: what is published.
        site: its name.
        names: of the pipelines, in their order.
        clock: monotonic.

    Attributes:
        ticks: closed and said by the primary pipeline.
        withheld: estimates that the overrun policy did not publish.
        contest: of all pipelines against the one that was primary at first.
        lateness: of a tick's estimate behind the instant at which the tick could close.
    """

    def __init__(
        self,
        replica: Folding,
        ledger: Ledger,
        outbox: Outbox,
        settings: LiveSettings,
        *,
        site: str,
        names: Sequence[str],
        clock: Clock,
    ) -> None:
        """Begin with nothing said."""
        self._replica = replica
        self._ledger = ledger
        self._outbox = outbox
        self._settings = settings
        self._site = site
        self._names = tuple(names)
        self._clock = clock
        self.ticks = 0
        self.withheld = 0
        self.lateness = Histogram()
        self.contest = Contest(self._names, self.primary)

    @property
    def primary(self) -> str:
        """The pipeline that is published; the last one where the chosen one is left out."""
        chosen = self._replica.primary or self._settings.primary
        return chosen if chosen in self._names else self._names[-1]

    def say(self, said: Sequence[Saying], due_ns: int | None) -> None:
        """Write down what the kernel says; what is to be published waits for the commit.

        Args:
            said: in a run of the kernel for one device, revisions first.
            due_ns: when it could be said at the earliest; None where nobody waited for it.
        """
        now_ns, primary, everyone = self._clock.monotonic_ns(), self.primary, self._settings.publish == "all"
        overrun = due_ns is not None and now_ns - due_ns > TICK_NS and self._settings.overrun == "newest"
        published = [estimate for estimate in said if not estimate.revision]
        newest = published[-1].tick if published else None
        self.contest.said(published)
        for estimate in said:
            self._ledger.estimate(estimate)
            if estimate.revision == 0 and estimate.pipeline == primary:
                self.ticks += 1
                if due_ns is not None:
                    self.lateness.add((now_ns - due_ns) * 1e-6)
            if not everyone and estimate.pipeline != primary:
                continue
            if estimate.revision == 0 and overrun and estimate.tick != newest:
                self.withheld += 1
                continue
            family: Family = "revision" if estimate.revision else "estimate"
            self._outbox.say(
                Said(family, self._site, estimate.floor, estimate.device, estimate.pipeline, estimate.body)
            )
