"""What observers are handed: the run they watch, epochs, faults and overruns as immutable values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """The run that a hook call belongs to.

    Attributes:
        id: of the run; a recording's name in a replay, the engine's run id live.
        mode: ``"replay"`` of a recording, a ``"live"`` engine, or one that follows another (``"follow"``).
        site: name of the site, empty if a replay has none.
        pipelines: names, in the order of their estimates within a tick.
    """

    id: str
    mode: Literal["replay", "live", "follow"]
    site: str = ""
    pipelines: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class EpochStart:
    """A device was located for the first time, or for the first time since its clock started again.

    Attributes:
        device: whose clock.
        epoch: counts the starts of that clock, from 0.
        t_ns: device time of the epoch's first estimate.
    """

    device: str
    epoch: int
    t_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class StageFault:
    """A call of an algorithm that failed; estimates of that tick have the status ``failed``.

    Attributes:
        stage: kind and name, as ``filter 'fusion-pf'``.
        error: the exception's class name.
        detail: the exception's text; it may differ between runs and machines.
    """

    stage: str
    error: str
    detail: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Overrun:
    """A live engine fell behind for longer than ``overload_s``, or caught up again.

    Attributes:
        active: True when it fell behind: new devices are refused from now on; False when it caught up.
        lag_s: how far the oldest due tick was behind, seconds.
        devices: number of devices followed.
    """

    active: bool
    lag_s: float
    devices: int
