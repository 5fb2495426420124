"""Settings of the ports (addresses, keys, limits per peer), and the clocks that the ports read."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from pathlib import Path

from tickfix.api.errors import ConfigError
from tickfix.wire.sensor_messages import MessageLimits


@dataclass(frozen=True, slots=True)
class Clock:
    """Where the time comes from.

    Attributes:
        monotonic_ns: never goes back; durations and limits.
        wall_ns: ns since 1970; when something arrived, for people and journals.
        sleep: lets so many seconds pass.
    """

    monotonic_ns: Callable[[], int] = time.monotonic_ns
    wall_ns: Callable[[], int] = time.time_ns
    sleep: Callable[[float], None] = time.sleep


@dataclass(frozen=True, slots=True, kw_only=True)
class PeerLimits:
    """How much one peer may send: a key where CURVE is on, a connection otherwise.

    Attributes:
        messages_per_s, message_burst: a bucket that holds ``message_burst`` messages and refills at this rate.
        bytes_per_s, byte_burst: the same for bytes.
        devices: how many devices one peer may speak for.
    """

    messages_per_s: float = 1_000.0
    message_burst: int = 3_000
    bytes_per_s: float = 8 * 2**20
    byte_burst: int = 32 * 2**20
    devices: int = 256


@dataclass(frozen=True, slots=True, kw_only=True)
class PortSettings:
    """Where the ports are and what they let in.

    Attributes:
        sensors, positions, control, follow: addresses to bind, ``tcp://HOST:PORT`` or ``ipc://PATH``; the port ``*``
            takes a free one. ``follow`` may be empty: then no engine can follow.
        keys: folder made by ``tickfix keys``; with it every port speaks CURVE and nothing else.
        message: what one message may hold.
        peer: how much one peer may send; an entry of the allow-list overrides it.
        devices: how many devices there may be in all.
        queue_messages, queue_bytes: how much may wait for the loop; what is beyond is answered ``busy``.
        takeover_s: how long a device must be silent before another peer may speak for it without a ``hello``.
        idle_s: how long a device must be silent before its place may go to a new one.
        heartbeat_s: period of the heartbeats on the positions port.
    """

    sensors: str = "tcp://127.0.0.1:5571"
    positions: str = "tcp://127.0.0.1:5572"
    control: str = "tcp://127.0.0.1:5573"
    follow: str = "tcp://127.0.0.1:5574"
    keys: Path | None = None
    message: MessageLimits = field(default_factory=MessageLimits)
    peer: PeerLimits = field(default_factory=PeerLimits)
    devices: int = 2_000
    queue_messages: int = 20_000
    queue_bytes: int = 128 * 2**20
    takeover_s: float = 2.0
    idle_s: float = 600.0
    heartbeat_s: float = 1.0

    def __post_init__(self) -> None:
        """Check that limits are positive and that the largest message fits into its bucket and the queue.

        Raises:
            ConfigError: naming the setting.
        """
        for where, owner in (("ports", self), ("ports.peer", self.peer)):
            for setting in fields(owner):
                value = getattr(owner, setting.name)
                if isinstance(value, int | float) and not value > 0:
                    raise ConfigError(f"{where}.{setting.name}", repr(value), "a number > 0")
        for where, room in (("peer.byte_burst", self.peer.byte_burst), ("queue_bytes", self.queue_bytes)):
            if room < self.message.message_bytes:
                expected = f"at least ports.message.message_bytes = {self.message.message_bytes}"
                raise ConfigError(f"ports.{where}", repr(room), expected)
