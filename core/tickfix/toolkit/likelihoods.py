"""How well places explain an observation: its own likelihood where it offers one, else its fix as an error model."""

from __future__ import annotations

import numpy as np

from tickfix.api import Floats, Observation
from tickfix.toolkit.fix_errors import sigma_per_axis_m


def offered_log_likelihood(observation: Observation, floor: str, xy: Floats) -> Floats | None:
    """Return (n,) the log-likelihood that the observation offers for places, None where it offers none.

    Args:
        observation: of a fingerprint.
        floor: on which the places lie.
        xy: (n, 2) float64, metres, floor frame.

    Raises:
        ValueError: when it returns another shape, or NaN or +∞.
    """
    if observation.log_likelihood is None:
        return None
    found = np.asarray(observation.log_likelihood(floor, xy), dtype=np.float64)
    if found.shape != (len(xy),):
        raise ValueError(f"log_likelihood of {observation.source}: found shape {found.shape}, expected ({len(xy)},)")
    if np.isnan(found).any() or np.isposinf(found).any():
        raise ValueError(f"log_likelihood of {observation.source}: found NaN or +∞, expected numbers or −∞")
    return found


def log_likelihood(observation: Observation, floor: str, xy: Floats, *, student_t_dof: float = 4.0) -> Floats | None:
    """Return (n,) how well places explain an observation, up to a constant; None where it tells nothing.

    Where the observation offers no likelihood, its fix is taken as Student's t in two dimensions with the σ per axis of
    its covariance; a fix on another floor gives −∞ everywhere.

    Args:
        observation: of a fingerprint.
        floor: on which the places lie.
        xy: (n, 2) float64, metres, floor frame.
        student_t_dof: degrees of freedom ν, > 0.

    Raises:
        ValueError: when the observation's own likelihood is not usable.
    """
    offered = offered_log_likelihood(observation, floor, xy)
    if offered is not None or observation.fix is None:
        return offered
    fix = observation.fix
    if fix.floor != floor:
        return np.full(len(xy), -np.inf)
    squares: Floats = (((fix.xy - xy) / sigma_per_axis_m(fix)) ** 2).sum(axis=1)
    return -0.5 * (student_t_dof + 2.0) * np.log1p(squares / student_t_dof)
