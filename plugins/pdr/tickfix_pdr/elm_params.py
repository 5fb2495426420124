"""What can be chosen of pdr ``elm``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from tickfix.api import TICK_NS, parameter

Activation = Literal["hardlim", "sigmoid"]


@dataclass(frozen=True)
class ElmParams:
    """Parameters of ``elm``."""

    window_ms: Annotated[
        int,
        parameter(
            "T_w, whole ticks over whose samples features are averaged; the last one is told",
            unit="ms",
            source="[jiang2015] 8.2.1",
            ge=200,
            trains=True,
        ),
    ] = 200
    velocity_nodes: Annotated[
        tuple[int, ...], parameter("hidden nodes to choose from", source="[jiang2015] 8.2.2", trains=True)
    ] = (25, 50, 100, 200, 400)
    heading_nodes: Annotated[
        tuple[int, ...], parameter("hidden nodes to choose from", source="[jiang2015] 8.2.2", trains=True)
    ] = (25, 50, 100, 200, 400)
    velocity_activation: Annotated[
        Activation, parameter("g(x) for the velocity", source="[jiang2015] 8.2.2", trains=True)
    ] = "hardlim"
    heading_activation: Annotated[
        Activation, parameter("g(x) for the orientation", source="[jiang2015] 8.2.2", trains=True)
    ] = "sigmoid"
    fold_count: Annotated[
        int, parameter("folds of the cross-validation", source="[jiang2015] 8.2.2", ge=2, trains=True)
    ] = 10
    keep_chains: Annotated[bool, parameter("folds keep a chain of walks together; else at random", trains=True)] = True
    as_vector: Annotated[
        bool, parameter("regress the heading as sine and cosine; else the plain angle", trains=True)
    ] = True
    ridge: Annotated[
        float, parameter("regularisation per sample", source="[jiang2015] eq. (10)", gt=0, trains=True)
    ] = 1e-3
    still_mps2: Annotated[
        float, parameter("a phone that shakes less is at rest; 0: as the network says", unit="m/s²", ge=0)
    ] = 0.15

    def __post_init__(self) -> None:
        """Check the window.

        Raises:
            ValueError: when it is not made of whole ticks.
        """
        if self.window_ms * 1_000_000 % TICK_NS:
            raise ValueError(f"window_ms: found {self.window_ms}, expected a multiple of {TICK_NS // 1_000_000}")
