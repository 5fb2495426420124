"""The schemes that are compared, as pipelines: Wi-Fi alone, PDR alone, WPO and MWPO, and filters of many sizes."""

from __future__ import annotations

from typing import Final

GCK: Final = "GCK"
PDR: Final = "PDR"
WPO: Final = "WPO"
MWPO: Final = "MWPO"
SCHEMES: Final = (GCK, PDR, WPO, MWPO)
NO_MAP: Final = "MWPO without map"
BY_EKF: Final = "MWPO walking by the EKF"
"""The other reading of section 5: particles walk by the EKF's velocity, so that P-O reaches them only through it."""
DROPPED: Final = ", failing fixes dropped"
"""The other reading of eq. (22): what fails the δS test is not input at all."""

UNMAPPED_PARTICLES: Final = (100, 200, 300, 400, 500)
"""Table 1."""
MAPPED_PARTICLES: Final = (40, 50, 60, 70, 80)
"""Table 2."""
PARTICLES: Final = (*MAPPED_PARTICLES, *UNMAPPED_PARTICLES)

DISTURBED: Final = (WPO, MWPO, WPO + DROPPED, MWPO + DROPPED, BY_EKF, NO_MAP)
"""The schemes that gross errors are put into."""

_INPUT: Final = """
pdr = { use = "pseudo-odometry", preset = "wang2015" }
fingerprint = { use = "topology-knn", preset = "wang2015" }
"""
_MAP: Final = 'map = "regions"\n'


def sized(particles: int, *, mapped: bool) -> str:
    """Return the name of the filter of this size."""
    return f"{particles} particles {'with' if mapped else 'without'} map"


def dead_reckoning() -> str:
    """Return the configuration of scheme 2, which starts at a known place."""
    return f'[pipelines."{PDR}"]\npdr = {{ use = "pseudo-odometry", preset = "wang2015" }}\nfilter = "dead-reckoning"\n'


def aided() -> str:
    """Return the configuration of all schemes that start at their first fix."""
    parts = [
        f'[pipelines."{GCK}"]\nfingerprint = {{ use = "topology-knn", preset = "wang2015" }}\nfilter = "fixes"\n',
        _pipeline(WPO, '{ use = "fading-ekf", preset = "wang2015" }'),
        _pipeline(WPO + DROPPED, '{ use = "fading-ekf", preset = "wang2015-reject" }'),
        _pipeline(MWPO, '{ use = "map-pf", preset = "wang2015" }') + _MAP,
        _pipeline(MWPO + DROPPED, '{ use = "map-pf", preset = "wang2015", reject_go_and_back = true }') + _MAP,
        _pipeline(BY_EKF, '{ use = "map-pf", preset = "wang2015-ekf" }') + _MAP,
        _pipeline(NO_MAP, '{ use = "map-pf", preset = "wang2015" }'),
    ]
    for particles in PARTICLES:
        use = f'{{ use = "map-pf", preset = "wang2015", particles = {particles} }}'
        parts.append(_pipeline(sized(particles, mapped=False), use))
        parts.append(_pipeline(sized(particles, mapped=True), use) + _MAP)
    return "\n".join(parts)


def _pipeline(name: str, use: str) -> str:
    return f'[pipelines."{name}"]{_INPUT}filter = {use}\n'
