"""What an engine is to serve, and the table ``[live]`` of its configuration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from tickfix.config import Config
from tickfix.live.heartbeat import MAX_WORKERS

PositiveSeconds = Annotated[float, Meta(gt=0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveSettings:
    """How the loop runs.

    Attributes:
        grace_ms: how long after its time a tick waits for data that has not come.
        coast_s: a device that sends nothing still gets its ticks for so long; then they wait for it.
        expire_s: a device that was silent for so long is settled and forgotten.
        primary: the pipeline whose estimates are published; empty means the last one of the configuration.
        publish: estimates of the primary only, or of all pipelines. The journal has all.
        overrun: what is published when several ticks of a device are folded at once because the loop is late: each of
            them, or the newest; ``fail`` stops the engine when it stays late. All of them are folded in any case.
        round_ms: rounds of the loop begin at least so far apart, so that devices which are due at about the same time
            are folded together; a position waits for half of it on the average.
        durability: with ``ack`` an acknowledgement waits until its event is on the disk. With ``interval`` it waits
            only until its event survives this process; a loss of power may cost the last ``journal.sync_ms``.
        workers: processes that fold, each the devices that are its own; 0 folds in the engine's process.
        locate_timeout_s: a scan that is not located by then is given up.
        locators: threads that locate scans, in each process that folds.
        overload_s: the loop is overloaded when it has been late by more than this for as long.
        watchdog_s: an engine that shows no sign of life for so long is restarted without the stage that it hangs in.
    """

    grace_ms: Annotated[float, Meta(ge=0)] = 300.0
    coast_s: Annotated[float, Meta(ge=0)] = 5.0
    expire_s: PositiveSeconds = 600.0
    primary: str = ""
    publish: Literal["primary", "all"] = "primary"
    overrun: Literal["each", "newest", "fail"] = "each"
    round_ms: Annotated[float, Meta(ge=0, le=100)] = 5.0
    durability: Literal["interval", "ack"] = "interval"
    workers: Annotated[int, Meta(ge=0, le=MAX_WORKERS)] = 0
    locate_timeout_s: PositiveSeconds = 5.0
    locators: Annotated[int, Meta(ge=1, le=64)] = 1
    overload_s: PositiveSeconds = 1.0
    watchdog_s: PositiveSeconds = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ServeOptions:
    """What to serve.

    Attributes:
        site: folder of the site.
        config: pipelines, and the tables ``[live]``, ``[ports]`` and ``[journal]``.
        journal: folder; None keeps no journal.
        resume: go on with the journal's newest run.
        follow: address of another engine's follow port; then its events and decisions are folded, and no sensors.
        follow_key: own key for that port, as a file with ``engine.pub`` beside it; None where none is asked for.
        disabled: keys and labels of stages that must not run; pipelines that need one are left out.
    """

    site: Path
    config: Config
    journal: Path | None = None
    resume: bool = False
    follow: str = ""
    follow_key: Path | None = None
    disabled: Mapping[str, str] = field(default_factory=dict)
