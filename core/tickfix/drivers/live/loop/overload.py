"""Telling overload from a hiccup: it must last to be announced, and be gone for as long to be over."""

from __future__ import annotations

from typing import Final

_RECOVERED: Final = 0.25
_SPAN: Final = 3.0


class Overload:
    """Watches how late the loop is.

    It is overloaded when it was later than ``limit_s`` for three times as long without a break, and recovers when it
    was no later than a quarter of it for as long.
    """

    def __init__(self, limit_s: float) -> None:
        """Begin with all well."""
        self._limit_ns = round(limit_s * 1e9)
        self._span_ns = round(_SPAN * limit_s * 1e9)
        self._since_ns: int | None = None
        self.announced = False
        self.times = 0

    def late(self, lateness_ns: int, now_ns: int) -> bool:
        """Take note of how late the loop is now; return whether it has just become overloaded, or just recovered."""
        recovered, behind = lateness_ns <= _RECOVERED * self._limit_ns, lateness_ns > self._limit_ns
        turning = recovered if self.announced else behind
        if not turning:
            self._since_ns = None
            return False
        if self._since_ns is None:
            self._since_ns = now_ns
        if now_ns - self._since_ns < self._span_ns:
            return False
        self.announced = not self.announced
        self.times += self.announced
        self._since_ns = None
        return True
