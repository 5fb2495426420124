"""An extreme learning machine that tells classes apart, [jiang2015] section 4 and its eqs. (4)–(10).

A network with one hidden layer whose weights stay as they were drawn; only the output weights are learnt, by linear
least squares. The ridge makes that well-posed with any number of hidden nodes, and one Cholesky factor of a matrix as
large as the hidden layer is all it takes.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.special

from tickfix.api import Floats, Ints


def hidden_layer(x: Floats, a: Floats, b: Floats) -> Floats:
    """Return H (n, L): the sigmoid outputs G(a_i, b_i, x) of the L hidden nodes.

    Args:
        x: (n, F) inputs, of about unit size.
        a: (F, L) input weights.
        b: (L,) biases.
    """
    H: Floats = scipy.special.expit(x @ a + b)
    return H


def output_weights(H: Floats, classes: Ints, count: int, ridge: float) -> Floats:
    """Return β (L, ``count``) that minimises |Hβ − T|² + ridge·|β|², T being 1 at each row's class and 0 elsewhere.

    [jiang2015] eq. (10) takes the pseudo-inverse of H; with a small ridge it is the same and never singular.

    Args:
        H: (n, L) hidden layer.
        classes: (n,) int64, class of each row, 0 to ``count`` − 1.
        count: number of classes.
        ridge: > 0.
    """
    n, L = H.shape
    T = scipy.sparse.csr_matrix((np.ones(n), (classes, np.arange(n))), shape=(count, n))
    factor = scipy.linalg.cho_factor(H.T @ H + ridge * np.eye(L), lower=True)
    beta: Floats = scipy.linalg.cho_solve(factor, (T @ H).T)
    return beta
