"""The schemes that are compared, as pipelines: Wi-Fi alone, PDR alone, WPO and MWPO, and filters of many sizes."""

from __future__ import annotations

from typing import Final

GCK: Final = "GCK"
PDR: Final = "PDR"
WPO: Final = "WPO"
MWPO: Final = "MWPO"
SCHEMES: Final = (GCK, PDR, WPO, MWPO)
NO_MAP: Final = "MWPO, no map"
BY_EKF: Final = "MWPO, EKF's walk"
"""The other reading of section 5: particles walk by the EKF's velocity, so that P-O reaches them only through it."""
DROPPED: Final = ", dropping"
"""The other reading of eq. (22): what fails the δS test is not input at all."""

UNMAPPED_PARTICLES: Final = (100, 200, 300, 400, 500)
"""Table 1."""
MAPPED_PARTICLES: Final = (40, 50, 60, 70, 80)
"""Table 2."""
PARTICLES: Final = (*MAPPED_PARTICLES, *UNMAPPED_PARTICLES)

DISTURBED: Final = (WPO, MWPO, WPO + DROPPED, MWPO + DROPPED, BY_EKF, NO_MAP)
"""The schemes that gross errors are put into."""

_ODOMETRY: Final = 'pdr = { use = "pseudo-odometry", preset = "wang2015" }\n'
_MAP: Final = 'map = "regions"\n'


def sized(particles: int, *, mapped: bool) -> str:
    """Return the name of the filter of this size."""
    return f"{particles} particles {'with' if mapped else 'without'} map"


def dead_reckoning() -> str:
    """Return the configuration of scheme 2, which starts at a known place."""
    return f'[pipelines."{PDR}"]\n{_ODOMETRY}filter = "dead-reckoning"\n'


def wifi_alone(sigma_m: float | None = None) -> str:
    """Return the configuration of scheme 1; ``sigma_m`` is the noise of its fixes per axis, where that is known."""
    return f'[pipelines."{GCK}"]\n{_fingerprint(sigma_m)}filter = "fixes"\n'


def aided(sigma_m: float) -> str:
    """Return the configuration of all schemes that start at their first fix, whose noise per axis is ``sigma_m``."""
    given = _ODOMETRY + _fingerprint(sigma_m)

    def pipeline(name: str, use: str) -> str:
        return f'[pipelines."{name}"]\n{given}filter = {use}\n'

    parts = [
        wifi_alone(sigma_m),
        pipeline(WPO, '{ use = "fading-ekf", preset = "wang2015" }'),
        pipeline(WPO + DROPPED, '{ use = "fading-ekf", preset = "wang2015-reject" }'),
        pipeline(MWPO, '{ use = "map-pf", preset = "wang2015" }') + _MAP,
        pipeline(MWPO + DROPPED, '{ use = "map-pf", preset = "wang2015", reject_go_and_back = true }') + _MAP,
        pipeline(BY_EKF, '{ use = "map-pf", preset = "wang2015-ekf" }') + _MAP,
        pipeline(NO_MAP, '{ use = "map-pf", preset = "wang2015" }'),
    ]
    for particles in PARTICLES:
        use = f'{{ use = "map-pf", preset = "wang2015", particles = {particles} }}'
        parts.append(pipeline(sized(particles, mapped=False), use))
        parts.append(pipeline(sized(particles, mapped=True), use) + _MAP)
    return "\n".join(parts)


def _fingerprint(sigma_m: float | None) -> str:
    noise = "" if sigma_m is None else f", sigma_m = {sigma_m!r}"
    return f'fingerprint = {{ use = "topology-knn", preset = "wang2015"{noise} }}\n'
