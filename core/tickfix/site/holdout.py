"""Which walks a survey holds out for testing: whole chains, chosen by a hash that anyone can repeat.

Surveyors walk in chains: a walk often starts where and when the one before it ended. A split that cuts a chain leaks,
so the rule is, word by word: per floor, walks are ordered by (time of first waypoint, file name); a walk joins the
chain of the latest-ending earlier walk whose last waypoint lies ≤ 0.5 m from its first and ended 0–60 s before it; a
chain is held out when ``int(sha256(file name of its first walk without extensions).hexdigest(), 16) % 1000 <
1000·holdout``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from hashlib import sha256
from typing import Final

from tickfix.api import Recording, SiteError, Truth

NEAR_M: Final = 0.5
SOON_NS: Final = 60_000_000_000


def chains(recordings: Iterable[Recording]) -> dict[str, str]:
    """Return the chain of every walk that has waypoints: walk name → name of the chain's first walk.

    Names must be unique. The result is ordered by (floor, time of first waypoint, name) and does not depend on the
    order of ``recordings``.
    """
    walks = [(recording, truth[0], truth[-1]) for recording in recordings if (truth := recording.truth)]
    walks.sort(key=lambda walk: (walk[0].floor, walk[1].t_ns, walk[0].name))
    chain: dict[str, str] = {}
    for i, (recording, first, _) in enumerate(walks):
        before = [
            (earlier.name, last.t_ns)
            for earlier, _, last in walks[:i]
            if earlier.floor == recording.floor and _follows(first, last)
        ]
        chain[recording.name] = chain[max(before, key=lambda walk: walk[1])[0]] if before else recording.name
    return chain


def is_held_out(chain: str, holdout: float) -> bool:
    """Tell whether the chain whose first walk is called ``chain`` is held out, of a share ``holdout`` in [0, 1].

    Raises:
        SiteError: when the share is none.
    """
    if not 0.0 <= holdout <= 1.0:
        raise SiteError(f"holdout: found {holdout}, expected a share from 0 to 1")
    return int(sha256(chain.encode()).hexdigest(), 16) % 1000 < 1000 * holdout


def _follows(first: Truth, last: Truth) -> bool:
    near = math.hypot(first.xy[0] - last.xy[0], first.xy[1] - last.xy[1]) <= NEAR_M
    return near and 0 <= first.t_ns - last.t_ns <= SOON_NS
