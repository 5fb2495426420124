"""Counters and durations of an engine as Prometheus metrics.

The loop counts with plain integers and :class:`DurationHistogram`, because it counts every estimate: an observation of
a ``prometheus_client`` histogram takes a lock and several microseconds. :class:`EngineCollector` turns the report from
which the status is made into metrics when they are asked for, so both always show the same numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.registry import Collector

_PER_DECADE: Final = 40
_SMALLEST_MS: Final = 1e-3
_BUCKETS: Final = 11 * _PER_DECADE + 2
_BOUNDS: Final = (0, 12, 28)
"""Buckets of a decade that end close to 1, 2 and 5."""


class DurationHistogram:
    """Counts durations in buckets that grow by 6 %, from a microsecond to a day; quantiles are as exact as that."""

    __slots__ = ("_buckets", "count", "max_ms", "sum_ms")

    def __init__(self) -> None:
        """Begin empty."""
        self._buckets = [0] * _BUCKETS
        self.count = 0
        self.max_ms = 0.0
        self.sum_ms = 0.0

    def add(self, ms: float) -> None:
        """Count a duration; one below zero counts as zero."""
        place = 0 if ms < _SMALLEST_MS else 1 + int(math.log10(ms / _SMALLEST_MS) * _PER_DECADE)
        self._buckets[min(place, _BUCKETS - 1)] += 1
        self.count += 1
        self.max_ms = max(self.max_ms, ms)
        self.sum_ms += max(ms, 0.0)

    def quantile_ms(self, q: float) -> float:
        """Return the upper end of the bucket in which the quantile lies, at most the greatest; 0 when empty."""
        wanted, seen = q * self.count, 0
        for place, n in enumerate(self._buckets):
            seen += n
            if n and seen >= wanted and place == _BUCKETS - 1:
                return self.max_ms
            if n and seen >= wanted:
                return min(self.max_ms, _SMALLEST_MS * 10 ** (place / _PER_DECADE))
        return 0.0

    def cumulative(self, decades_from: int = 2, decades_to: int = 7) -> list[tuple[float, int]]:
        """Return upper bounds in ms, three per decade, and how many durations were at most as long.

        Args:
            decades_from, decades_to: decades above a microsecond: from 0.1 ms to 10 s by default.
        """
        # Every bound is the upper end of a bucket, so that the counts are exact: 2 and 5 of a decade are approximate.
        places = (
            p for p in range(decades_from * _PER_DECADE, decades_to * _PER_DECADE + 1) if p % _PER_DECADE in _BOUNDS
        )
        return [(_SMALLEST_MS * 10 ** (p / _PER_DECADE), sum(self._buckets[: p + 1])) for p in places]

    def summary(self) -> dict[str, float]:
        """Return p50, p99 and max in milliseconds, and the count."""
        return {
            "p50": self.quantile_ms(0.5),
            "p99": self.quantile_ms(0.99),
            "max": self.max_ms,
            "count": self.count,
        }


_COUNTERS: Final[Mapping[str, tuple[str, str]]] = {
    "ticks": ("ticks", "Ticks closed by the primary pipeline."),
    "rounds": ("rounds", "Rounds of the loop."),
    "suppressed": ("suppressed_estimates", "Estimates that the overrun policy did not publish."),
    "overloads": ("overloads", "How often the loop became overloaded."),
    "expired_devices": ("expired_devices", "Devices finished because they were silent."),
    "deferred": ("deferred_messages", "Messages answered busy because earlier data has to be folded first."),
    "errors": ("message_errors", "Messages that could not be admitted because of an unforeseen error."),
}
"""Key of the report: name and description of the metric."""

_LABELLED: Final[Mapping[str, tuple[str, str, str]]] = {
    "measurements": ("measurements", "outcome", "Samples, readings and fixes, by what the kernel made of them."),
    "failures": ("stage_failures", "stage", "Failed stage calls."),
    "replication": ("replication_records", "outcome", "Records of the leader."),
}
"""Key of the report: name, label and description of the metric."""


class EngineCollector(Collector):
    """Makes metrics of an engine's report; to be collected on the loop's thread.

    Args:
        report: returns the engine's report.
        durations: histograms in milliseconds by the name of their metric, which is in seconds.
    """

    def __init__(self, report: Callable[[], Mapping[str, Any]], durations: Mapping[str, DurationHistogram]) -> None:
        """Collect nothing yet."""
        self._report = report
        self._durations = dict(durations)

    def collect(self) -> Iterator[Metric]:
        """Yield the metrics as they are now."""
        report = self._report()
        for key, (name, description) in _COUNTERS.items():
            if key in report:
                yield CounterMetricFamily(f"tickfix_{name}", description, value=report[key])
        for key, (name, label, description) in _LABELLED.items():
            if key in report:
                counter = CounterMetricFamily(f"tickfix_{name}", description, labels=[label])
                for value, count in sorted(report[key].items()):
                    counter.add_metric([value], count)
                yield counter
        yield GaugeMetricFamily("tickfix_devices", "Devices followed.", value=report["devices"])
        yield GaugeMetricFamily(
            "tickfix_missing_messages",
            "Message numbers passed over and not arrived, of the devices followed.",
            value=report["missing_messages"],
        )
        yield GaugeMetricFamily(
            "tickfix_overloaded", "1 while new devices are refused.", value=float(report["overload"] is not None)
        )
        if scans := report.get("scans"):
            yield GaugeMetricFamily("tickfix_scans_in_flight", "Scans being located.", value=scans["in_flight"])
            yield CounterMetricFamily("tickfix_scans_timed_out", "Scans not located in time.", value=scans["timed_out"])
        if journal := report["journal"]:
            yield GaugeMetricFamily("tickfix_journal_records", "Records of the run.", value=journal["records"])
            yield GaugeMetricFamily(
                "tickfix_journal_durable_records", "Records that are on the disk.", value=journal["durable"]
            )
        for name, histogram in self._durations.items():
            buckets = [(f"{bound_ms * 1e-3:.4g}", count) for bound_ms, count in histogram.cumulative()]
            family = HistogramMetricFamily(f"tickfix_{name}_seconds", f"{name.replace('_', ' ').capitalize()}.")
            family.add_metric([], [*buckets, ("+Inf", histogram.count)], sum_value=histogram.sum_ms * 1e-3)
            yield family
