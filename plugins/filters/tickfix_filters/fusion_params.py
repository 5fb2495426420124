"""Parameters of ``fusion-pf``, and the values with which it is the particle filter that [jiang2015] prints."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Final, Literal

from tickfix.api import Preset, parameter
from tickfix_filters.noise import FixErrorParams


@dataclass(frozen=True)
class FusionPfParams(FixErrorParams):
    """Parameters of ``fusion-pf``."""

    particles: Annotated[int, parameter("N, which is not printed", source="[jiang2015] section 6", ge=2)] = 500
    diffusion_m: Annotated[
        float,
        parameter(
            "way per square root of a second that no step explains; Q",
            unit="m/√s",
            source="[jiang2015] eq. (16)",
            ge=0,
        ),
    ] = 0.1
    own_ways: Annotated[
        bool, parameter("particles walk within what motion says of its errors; else all alike, eq. (16)")
    ] = True
    fix_sigma_m: Annotated[
        float,
        parameter(
            "σ of an observed place, per axis; 0: as the fix says", unit="m", source="[jiang2015] eq. (18)", ge=0
        ),
    ] = 0.0
    without_fix: Annotated[
        Literal["nothing", "motion"],
        parameter("what weighs particles in a tick without a fix: motion, the place it leads to; or nothing"),
    ] = "nothing"
    resampling: Annotated[
        Literal["systematic", "multinomial"], parameter("how particles are drawn; multinomial: with replacement, SIR")
    ] = "systematic"
    crossing_weight: Annotated[
        float, parameter("share of its weight a particle keeps when it crosses a wall", gt=0, le=1)
    ] = 0.2
    outside_weight: Annotated[
        float, parameter("share of its weight it keeps with each step where nobody can walk", gt=0, le=1)
    ] = 0.5
    aligned: Annotated[
        float,
        parameter(
            "share of ways that run along the nearest wall or straight away from it; 0: directions tell nothing",
            source="[borenstein2010]",
            ge=0,
            lt=1,
        ),
    ] = 0.6
    aligned_sigma_rad: Annotated[
        float, parameter("σ of their direction", unit="rad", source="[borenstein2010]", ge=0.05, le=0.5)
    ] = 0.15
    aligned_m: Annotated[
        float, parameter("a way this long is one piece of evidence: shorter ones repeat it", unit="m", gt=0)
    ] = 12.0
    renewed: Annotated[
        float, parameter("share of the particles that begin anew at a good fix", source="[lenser2000]", ge=0, lt=1)
    ] = 0.03
    renewed_lost: Annotated[
        float, parameter("the same while fixes and particles contradict each other", ge=0, lt=1)
    ] = 0.25
    renewed_sigma_m: Annotated[
        float, parameter("a fix with this σ is good; at a poorer one fewer begin anew", unit="m", gt=0)
    ] = 4.0
    scatter_m: Annotated[
        float, parameter("particles begin within no more than this σ around a fix, however poor", unit="m", gt=0)
    ] = 12.0
    surveyed_m: Annotated[
        float,
        parameter(
            "fixes have this σ where a survey came; poorer ones let walls, and their own distance, count for less",
            unit="m",
            gt=0,
        ),
    ] = 5.0
    astray_m: Annotated[
        float,
        parameter(
            "all particles begin anew once fixes lie this far off their mean, one way, for some scans", unit="m", gt=0
        ),
    ] = 15.0
    resample_below: Annotated[
        float, parameter("effective share of particles that calls for resampling", gt=0, le=1)
    ] = 0.5
    centre: Annotated[
        Literal["median", "mean"],
        parameter("the position told: spatial median, which errs least on average, or mean, which errs least squared"),
    ] = "median"

    def __post_init__(self) -> None:
        """Check what belongs together.

        Raises:
            ValueError: when motion is to weigh particles, but not how sharply.
        """
        if self.without_fix == "motion" and self.fix_sigma_m == 0.0:
            raise ValueError('fix_sigma_m: found 0 with without_fix = "motion", expected > 0: σ of eq. (18)')


JIANG2015: Final = Preset(
    "[jiang2015] sections 6–7, eqs. (14)–(19): SIR, by the fix where there is one, else by the motion result; knows no "
    "walls. σ is 50 without unit there, 50 cm is taken; Q is a variance of 0.1 m/s² there, 0.1 m² a tick is taken",
    {
        "diffusion_m": math.sqrt(0.1 / 0.2),  # 0.1 m² in 0.2 s
        "own_ways": False,
        "fix_sigma_m": 0.5,
        "without_fix": "motion",
        "resampling": "multinomial",
        "remembered": 0.0,
        "freedom": 1e12,  # Student's t is Gaussian then
        "crossing_weight": 1.0,
        "outside_weight": 1.0,
        "aligned": 0.0,
        "renewed": 0.0,
        "renewed_lost": 0.0,
        "scatter_m": 1e6,
        "astray_m": 1e6,
        "resample_below": 1.0,
        "centre": "mean",
    },
)
