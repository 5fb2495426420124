"""The fading factor λ of [wang2015] eqs. (19)–(21): by how much the past was trusted too far.

λ compares the residuals seen with those expected. Σ_V̄, whose recursion is not printed, is that of the strong tracking
filter, Σ_V̄ ← (ρ·Σ_V̄ + v·vᵀ)/(1 + ρ), [zhou1996] Zhou and Frank, "Strong tracking filtering of nonlinear time-varying
stochastic systems with coloured noise", Int. J. Control 65 (1996). M (5 × 5 of a 4-state covariance) has no inverse: λ
is tr N / tr M over the two rows of the place, or tr(N·M⁺)/n with n = rank M over all.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np

from tickfix.api import Floats, Ints

Fade: TypeAlias = Literal["trace", "pinv", "off"]
"""tr N / tr M of the place, tr(N·M⁺)/rank M of all rows, or 1."""


def residuals_covariance(V: Floats, seen: Ints, v: Floats, rows: Sequence[int], rho: float) -> tuple[Floats, Ints]:
    """Return Σ_V̄ (5, 5) with new residuals folded in, and which of its rows were ever seen (5,).

    Args:
        V, seen: the same before.
        v: (5,) residuals.
        rows: those of them that were measured.
        rho: ρ.
    """
    V, seen = V.copy(), seen.copy()
    for i in rows:
        for j in rows:
            known = seen[i] and seen[j]
            V[i, j] = (rho * V[i, j] + v[i] * v[j]) / (1.0 + rho) if known else v[i] * v[j]
    seen[rows] = 1
    return V, seen


def fading_factor(V: Floats, H: Floats, PhiPPhi: Floats, Q: Floats, R: Floats, rows: Sequence[int], how: Fade) -> float:
    """Return λ, eqs. (19)–(21).

    Args:
        V: (5, 5) Σ_V̄, this epoch's residuals included.
        H: (5, 4).
        PhiPPhi, Q: (4, 4), Φ P Φᵀ and the noise of the system.
        R: (5, 5), the noise of the observation.
        rows: those that were measured, for ``pinv``; ``trace`` looks at the place alone.
        how: one of :data:`Fade`.
    """
    if how == "off":
        return 1.0
    r = np.array(list(rows) if how == "pinv" else [0, 1], dtype=np.int64)
    H = H[r]
    M = H @ PhiPPhi @ H.T  # eq. (20)
    N = V[np.ix_(r, r)] - H @ Q @ H.T - R[np.ix_(r, r)]  # eq. (21)
    if how == "trace":
        return max(1.0, float(np.trace(N) / np.trace(M))) if np.trace(M) > 0.0 else 1.0
    n = int(np.linalg.matrix_rank(M, hermitian=True))
    return max(1.0, float(np.trace(N @ np.linalg.pinv(M, hermitian=True))) / max(n, 1))
