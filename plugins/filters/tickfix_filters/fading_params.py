"""Parameters of the fading-factor filter, [wang2015] section 4. Of the noises none is printed; δS is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from tickfix.api import parameter
from tickfix_filters.fading_factor import Fade


@dataclass(frozen=True)
class FadingParams:
    """Parameters of the fading-factor filter."""

    delta_s_m: Annotated[float, parameter("δS", unit="m", source="[wang2015] eq. (22), section 4.4", gt=0)] = 3.0
    reject_go_and_back: Annotated[
        bool, parameter("drop a fix that fails the δS test; otherwise it counts, with λ = 1", source="[wang2015] 4.3")
    ] = False
    patience: Annotated[int, parameter("after so many fixes dropped in a row the next one counts", ge=1)] = 5
    fading: Annotated[
        Fade,
        parameter("λ: tr N / tr M of the place, tr(N·M⁺)/rank M, or 1", source="[wang2015] eq. (19)"),
    ] = "trace"
    memory: Annotated[float, parameter("ρ of the residuals' covariance", source="[zhou1996]", ge=0, le=1)] = 0.95
    acceleration_mps2: Annotated[
        float, parameter("σ of W, north and east", unit="m/s²", source="[wang2015] eq. (9)", gt=0)
    ] = 0.5
    odometry_sigma_m: Annotated[
        float, parameter("σ of s_e and of s_n over 2 s; their variance grows with time", unit="m", gt=0)
    ] = 0.5
    heading_sigma_rad: Annotated[float, parameter("σ of the heading", unit="rad", gt=0)] = 0.3
    fix_sigma_m: Annotated[float, parameter("σ of N_wifi and of E_wifi; 0: as the fix says", unit="m", ge=0)] = 0.0
    crawl_mps: Annotated[float, parameter("slower than this the heading is left out", unit="m/s", gt=0)] = 0.3
    speed_sigma_mps: Annotated[float, parameter("σ of the first v_n and v_e", unit="m/s", ge=0)] = 1.0
