"""An estimate as the loop hands it on: its bytes, and what is needed to file and to compare it."""

from __future__ import annotations

import msgspec

from tickfix.api import Estimate
from tickfix.wire import encode_estimate


class Saying(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """An estimate that was encoded where it was made.

    Attributes:
        body: the estimate's bytes, as they are journaled and published.
        device, pipeline, tick, t_ns, revision, innovation_m, gate: the estimate's.
        floor, xy: of its belief, (x, y) in metres; None as long as there is none.
    """

    body: bytes
    device: str
    pipeline: str
    tick: int
    t_ns: int
    revision: int
    floor: str | None
    xy: tuple[float, float] | None
    innovation_m: float | None
    gate: float | None

    @classmethod
    def of(cls, estimate: Estimate) -> Saying:
        """Encode an estimate."""
        belief = estimate.belief
        floor = xy = None
        if belief is not None:
            x_m, y_m = belief.xy.tolist()
            floor, xy = belief.floor, (x_m, y_m)
        return cls(
            encode_estimate(estimate),
            estimate.device,
            estimate.pipeline,
            estimate.tick,
            estimate.t_ns,
            estimate.revision,
            floor,
            xy,
            estimate.innovation_m,
            estimate.gate,
        )
