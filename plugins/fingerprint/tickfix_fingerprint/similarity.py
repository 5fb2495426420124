"""How different a heard vector is from every reference point, all points at once.

What was not heard is zero in every representation (:mod:`tickfix_fingerprint.representation`). A distance therefore
splits into a part over the few transmitters heard now, and one over all others that a point knows beforehand; so the
cost grows with what was heard, not with what exists.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from tickfix.api import Floats, Ints, frozen

Similarity: TypeAlias = Literal["euclidean", "manhattan", "cosine", "sorensen"]


class References:
    """Reference vectors, ready to be compared.

    Args:
        matrix: (P, T) float64, each row a point's representation, ≥ 0, zero where it hears nothing.
    """

    def __init__(self, matrix: Floats) -> None:
        """Keep the matrix by transmitter, so that what was heard picks whole rows."""
        self._by_transmitter = frozen(matrix.T)
        self._total = frozen(matrix.sum(axis=1))
        self._squares = frozen((matrix**2).sum(axis=1))

    def distances(self, similarity: Similarity, heard: Ints, values: Floats) -> Floats:
        """Return how far each point is: (P,) float64.

        Args:
            similarity: ``euclidean`` √Σ(p−q)², ``manhattan`` Σ|p−q|, ``cosine`` 1 − p·q/|p||q|, ``sorensen`` (also
                called Bray–Curtis) Σ|p−q|/Σ(p+q).
            heard: (h,) int64, indices of the transmitters heard.
            values: (h,) float64, their representation q.
        """
        p = self._by_transmitter[heard]
        q = values[:, None]
        if similarity in ("euclidean", "cosine"):
            return self._by_squares(similarity, p, q)
        manhattan: Floats = np.abs(p - q).sum(axis=0) + self._total - p.sum(axis=0)
        if similarity == "manhattan":
            return np.maximum(manhattan, 0.0)
        both: Floats = self._total + values.sum()
        return np.divide(manhattan, both, out=np.ones_like(both), where=both > 0.0)

    def _by_squares(self, similarity: Similarity, p: Floats, q: Floats) -> Floats:
        if similarity == "euclidean":
            squares: Floats = ((p - q) ** 2).sum(axis=0) + self._squares - (p**2).sum(axis=0)
            return np.sqrt(np.maximum(squares, 0.0))
        norms: Floats = np.sqrt(self._squares * (q**2).sum())
        cosine: Floats = np.divide((p * q).sum(axis=0), norms, out=np.zeros_like(norms), where=norms > 0.0)
        return 1.0 - cosine
