"""Tracks a recording, or a stream of events in one's own asyncio loop; both fold with the same kernel."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterable, AsyncIterator, Iterable, Mapping
from dataclasses import replace
from os import PathLike
from types import MappingProxyType
from typing import Literal, TypeAlias

import numpy as np

from tickfix.api import TICK_NS, Estimate, Event, Fix, Recording
from tickfix.config import Config
from tickfix.evaluation.tracks import Track
from tickfix.evaluation.walk_runs import prepare, untrained
from tickfix.kernel import Kernel, KernelOutput
from tickfix.replay.driver import ReplayResult, replay_recording, split_batch, start_at_first_waypoint
from tickfix.site import Site
from tickfix.workflow.pipelines import PipelineSpec, resolve_pipeline, resolve_pipelines, warn_each
from tickfix.workflow.walks import read

SiteSource: TypeAlias = Site | str | PathLike[str]
"""A site, or the folder that one was saved to."""

Start: TypeAlias = Fix | Literal["first-waypoint"] | None
"""Where a walk begins, if that is known."""


def track(
    walk: Recording | str | PathLike[str],
    site: SiteSource,
    pipeline: PipelineSpec = "fusion",
    *,
    start: Start = None,
    final: bool = False,
    seed: int | None = None,
    strict: bool = False,
) -> Track:
    """Track one walk with one pipeline, as fast as possible, in the order in which its events arrived.

    Args:
        walk: a recording, or the file of one.
        site: what the pipeline is built for.
        pipeline: see :func:`tickfix.workflow.pipelines.resolve_pipelines`.
        start: where the walk begins; by default the pipeline finds that out itself.
        final: return the last revision of each tick (fixed-lag) instead of what was published at the time (causal).
        seed: of the random streams.
        strict: raise where a stage fails; otherwise the estimates say so and a warning counts them.

    Raises:
        ConfigError: when ``pipeline`` is not understood or stands for several.
        PluginError: when an algorithm cannot be built, or fails in a strict run.
    """
    config = resolve_pipeline(pipeline, seed=seed, strict=strict)
    (only,) = _track_all(walk, site, config, start, final=final).values()
    return only


def track_all(
    walk: Recording | str | PathLike[str],
    site: SiteSource,
    pipelines: PipelineSpec = None,
    *,
    start: Start = None,
    final: bool = False,
    seed: int | None = None,
    strict: bool = False,
) -> dict[str, Track]:
    """Track one walk with several pipelines side by side; stages that they share are computed once.

    The arguments are those of :func:`track`; by default tickfix's own four pipelines run.
    """
    config = resolve_pipelines(pipelines, seed=seed, strict=strict)
    return _track_all(walk, site, config, start, final=final)


def _track_all(
    walk: Recording | str | PathLike[str], site: SiteSource, config: Config, start: Start, *, final: bool
) -> dict[str, Track]:
    recording = walk if isinstance(walk, Recording) else read(walk)
    surveyed = as_site(site)
    warn_untrained(surveyed, config)
    setup = prepare(surveyed, config)
    fix = start_at_first_waypoint(recording) if start == "first-waypoint" else start
    replayed = replay_recording(recording, setup.pipelines, setup.settings, start=fix)
    warn_each([f"{recording.name}: {what} ({count} ×)" for what, count in replayed.failures.items()])
    keys = {p.name: p.fingerprint.key for p in setup.pipelines if p.fingerprint is not None}
    tracks = {}
    for name in replayed.published:
        fixes = tuple(replayed.fixes[keys[name]]) if name in keys else ()
        made = _final_track(name, replayed) if final else Track.of(name, recording.name, replayed.published[name])
        tracks[name] = replace(made, truth=recording.truth, floors=surveyed.floors, fixes=fixes)
    return tracks


def _final_track(pipeline: str, replayed: ReplayResult) -> Track:
    """Return the last revisions; each counts as known at its own tick, since they are looked at afterwards."""
    estimates = tuple(replayed.settled[pipeline])
    t_ns = np.array([estimate.t_ns for estimate in estimates], dtype=np.int64)
    return Track(
        pipeline=pipeline,
        device=replayed.recording.name,
        estimates=estimates,
        closed_ns=np.maximum.accumulate(t_ns) if len(t_ns) else t_ns,
    )


def as_site(site: SiteSource) -> Site:
    """Return a site, loaded where a folder is given."""
    return site if isinstance(site, Site) else Site.load(site)


def warn_untrained(site: Site, config: Config) -> None:
    """Warn of algorithms that learn, but for whose parameters the site has no model."""
    warn_each(
        [
            f"{label}: site {site.name!r} has no model for these parameters, so it runs untrained; "
            "survey with pipelines=… to train it"
            for label in untrained(site, config)
        ]
    )


class AsyncEngine:
    """The kernel in one's own event loop: no sockets, no threads, no clock.

    Estimates depend on the events alone: fed a recording's events in the order of their arrival, it publishes the same
    bits as :func:`track`. A tick closes when data passes it; :meth:`advance` closes ticks for which there is no data.

    Args:
        site: what the pipelines are built for.
        pipelines: see :func:`tickfix.workflow.pipelines.resolve_pipelines`.
        starts: where devices begin, by name, if that is known.
        seed: of the random streams.
        strict: raise where a stage fails.
    """

    def __init__(
        self,
        site: SiteSource,
        pipelines: PipelineSpec = "fusion",
        *,
        starts: Mapping[str, Fix] = MappingProxyType({}),
        seed: int | None = None,
        strict: bool = False,
    ) -> None:
        """Build the pipelines; no device is followed yet."""
        surveyed = as_site(site)
        config = resolve_pipelines(pipelines, seed=seed, strict=strict)
        warn_untrained(surveyed, config)
        setup = prepare(surveyed, config)
        self._kernel = Kernel(setup.pipelines, setup.settings, starts=starts)

    @property
    def devices(self) -> tuple[str, ...]:
        """Names of the devices that are followed now, in the order of their first event."""
        return self._kernel.devices

    @property
    def failures(self) -> Mapping[str, int]:
        """How often which stage failed, by stage and kind of error."""
        return MappingProxyType(dict(self._kernel.failures))

    def feed(self, event: Event, *, revisions: bool = False) -> list[Estimate]:
        """Take one event and return the estimates of the ticks that it closed, with ``revisions`` also the corrected.

        Revisions correct ticks that were published before an event that came late; ``Estimate.revision`` counts them.
        """
        for piece in split_batch(event):
            self._kernel.feed(piece)
        return _estimates(self._kernel.run(event.device), revisions=revisions)

    def advance(self, device: str, t_ns: int, *, revisions: bool = False) -> list[Estimate]:
        """Close a device's ticks up to ``t_ns`` on its clock, whether or not its data has come so far."""
        return _estimates(self._kernel.run(device, t_ns // TICK_NS), revisions=revisions)

    def finish(self, device: str, *, revisions: bool = False) -> list[Estimate]:
        """Fold what is left of a device and forget it."""
        return _estimates(self._kernel.finish(device), revisions=revisions)

    async def run(
        self, events: AsyncIterable[Event] | Iterable[Event], *, revisions: bool = False
    ) -> AsyncIterator[Estimate]:
        """Give estimates as events come, and the last ones of every device when the events end.

        Args:
            events: an asynchronous iterator, or a plain one; during a plain one the loop's other tasks get a turn
                after each event.
            revisions: give revisions too, see :meth:`feed`.
        """
        async for event in events if isinstance(events, AsyncIterable) else _turn_by_turn(events):
            for estimate in self.feed(event, revisions=revisions):
                yield estimate
        for device in self.devices:
            for estimate in self.finish(device, revisions=revisions):
                yield estimate


def _estimates(output: KernelOutput, *, revisions: bool) -> list[Estimate]:
    return output.emitted if revisions else list(output.published)


async def _turn_by_turn(events: Iterable[Event]) -> AsyncIterator[Event]:
    for event in events:
        yield event
        await asyncio.sleep(0)
