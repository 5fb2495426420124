"""Token buckets: how much one peer may send."""

from __future__ import annotations

from tickfix.ports.settings import PeerLimits


class Allowance:
    """What a peer may still send now: a bucket of messages and one of bytes, both full at the beginning.

    A message that is refused costs nothing, so that whoever slows down is heard again at once.
    """

    __slots__ = ("_at_ns", "_bytes", "_messages", "limits")

    def __init__(self, limits: PeerLimits, now_ns: int) -> None:
        """Begin with full buckets at ``now_ns`` of a monotonic clock."""
        self.limits = limits
        self._at_ns = now_ns
        self._messages = float(limits.message_burst)
        self._bytes = float(limits.byte_burst)

    def admits(self, n_bytes: int, now_ns: int) -> bool:
        """Take a message of ``n_bytes`` out of the buckets, or say that they do not hold it."""
        limits = self.limits
        elapsed_s = (now_ns - self._at_ns) / 1e9
        if elapsed_s > 0.0:
            self._at_ns = now_ns
            self._messages = min(self._messages + elapsed_s * limits.messages_per_s, limits.message_burst)
            self._bytes = min(self._bytes + elapsed_s * limits.bytes_per_s, limits.byte_burst)
        if self._messages < 1.0 or self._bytes < n_bytes:
            return False
        self._messages -= 1.0
        self._bytes -= n_bytes
        return True
