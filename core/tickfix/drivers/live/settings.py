"""Settings of the live loop: the table ``[live]`` of a configuration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from msgspec import Meta

from tickfix.drivers.live.watchdog.beacon import WORKERS

Positive = Annotated[float, Meta(gt=0)]


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
    expire_s: Positive = 600.0
    primary: str = ""
    publish: Literal["primary", "all"] = "primary"
    overrun: Literal["each", "newest", "fail"] = "each"
    round_ms: Annotated[float, Meta(ge=0, le=100)] = 5.0
    durability: Literal["interval", "ack"] = "interval"
    workers: Annotated[int, Meta(ge=0, le=WORKERS)] = 0
    locate_timeout_s: Positive = 5.0
    locators: Annotated[int, Meta(ge=1, le=64)] = 1
    overload_s: Positive = 1.0
    watchdog_s: Positive = 20.0
