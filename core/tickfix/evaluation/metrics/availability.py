"""When there was a position at all."""

from __future__ import annotations

from tickfix.evaluation.track import Track


def time_to_first_position_s(track: Track, start_ns: int) -> float | None:
    """Return the seconds from ``start_ns`` until a position was first published, None if none ever was.

    Args:
        track: as published.
        start_ns: arrival of the walk's first event.
    """
    for estimate, closed_ns in zip(track.estimates, track.closed_ns.tolist(), strict=True):
        if estimate.belief is not None:
            return float((closed_ns - start_ns) * 1e-9)
    return None
