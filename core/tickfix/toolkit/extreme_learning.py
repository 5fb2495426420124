"""Extreme learning machines.

[jiang2015] section 4, eqs. (4)-(10): one hidden layer with random weights that are never trained, and output weights
from regularised linear least squares. First the classifier; then regression, whose number of hidden nodes is chosen by
cross-validation: nodes are drawn for the largest network and a smaller one is its first L nodes, so HᵀH and HᵀT are
summed once per fold and a fold is left out by subtraction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.special
from scipy.linalg import cho_factor, cho_solve

from tickfix.api import Floats, Ints, Rng


def hidden_layer(x: Floats, a: Floats, b: Floats) -> Floats:
    """Return H (n, L): the sigmoid outputs G(a_i, b_i, x) of the L hidden nodes.

    Args:
        x: (n, F) inputs, of about unit size.
        a: (F, L) input weights.
        b: (L,) biases.
    """
    H: Floats = scipy.special.expit(x @ a + b)
    return H


def classifier_output_weights(H: Floats, classes: Ints, count: int, ridge: float) -> Floats:
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


@dataclass(frozen=True, slots=True, eq=False)
class RegressionElm:
    """A network of n features, L hidden nodes and m outputs.

    Attributes:
        activation: g of eq. (5), ``"sigmoid"`` or ``"hardlim"``.
        mean, scale: (n,) features are taken as (x − mean) / scale.
        a: (n, L) input weights.
        b: (L,) biases.
        beta: (L, m) output weights.
    """

    activation: str
    mean: Floats
    scale: Floats
    a: Floats
    b: Floats
    beta: Floats

    def __call__(self, x: Floats) -> Floats:
        """Return f_L(x) (N, m) for features (N, n), eq. (4)."""
        result: Floats = hidden_outputs(self, x) @ self.beta
        return result

    def arrays(self, name: str) -> dict[str, Any]:
        """Return the network as arrays, each key beginning with ``name``."""
        parts = {"mean": self.mean, "scale": self.scale, "a": self.a, "b": self.b, "beta": self.beta}
        return {f"{name}_{key}": value for key, value in parts.items()}

    @staticmethod
    def of(arrays: Mapping[str, Any], name: str, activation: str) -> RegressionElm:
        """Return the network that :meth:`arrays` took apart."""
        mean, scale, a, b, beta = (
            np.asarray(arrays[f"{name}_{key}"], dtype=np.float64) for key in ("mean", "scale", "a", "b", "beta")
        )
        return RegressionElm(activation, mean, scale, a, b, beta)


@dataclass(frozen=True, slots=True, eq=False)
class CrossValidatedElm:
    """A trained network and how it was chosen.

    Attributes:
        elm: trained on all samples.
        nodes: (c,) the numbers of nodes tried.
        mse: (c,) cross-validated mean square error of each, summed over outputs.
        held_out: (N, m) for each sample the output of the network of the chosen size that did not see its fold.
    """

    elm: RegressionElm
    nodes: Ints
    mse: Floats
    held_out: Floats


def hidden_outputs(elm: RegressionElm, x: Floats) -> Floats:
    """Return H (N, L), eq. (8)."""
    z = (x - elm.mean) / elm.scale @ elm.a + elm.b  # eq. (5)
    if elm.activation == "hardlim":
        return (z >= 0.0).astype(np.float64)
    sigmoid: Floats = 1.0 / (1.0 + np.exp(-np.clip(z, -500.0, 500.0)))
    return sigmoid


def solve_output_weights(gram: Floats, cross: Floats, n: int, ridge: float) -> Floats:
    """Return β (L, m) of (HᵀH + ridge·n·I) β = HᵀT: eq. (10), regularised, since random nodes may repeat each other."""
    beta: Floats = cho_solve(cho_factor(gram + ridge * max(n, 1) * np.eye(len(gram)), lower=True), cross)
    return beta


def random_network(x: Floats, nodes: int, outputs: int, activation: str, rng: Rng) -> RegressionElm:
    """Return a network of random hidden nodes for features like ``x`` (N, n); its β is zero."""
    scale = x.std(axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    a = rng.uniform(-1.0, 1.0, (x.shape[1], nodes))
    b = rng.uniform(-1.0, 1.0, nodes)
    return RegressionElm(activation, x.mean(axis=0), scale, a, b, np.zeros((nodes, outputs)))


def train_regression(
    x: Floats, t: Floats, fold: Ints, nodes: Sequence[int], *, activation: str, ridge: float, rng: Rng
) -> CrossValidatedElm:
    """Choose the number of hidden nodes by cross-validation and train on all samples.

    Args:
        x: (N, n) features.
        t: (N, m) targets.
        fold: (N,) which fold each sample belongs to, from 0.
        nodes: numbers of hidden nodes to choose from.
        activation: see :class:`RegressionElm`.
        ridge: regularisation, relative to the number of samples.
        rng: draws the hidden nodes.
    """
    sizes = np.array(sorted(set(nodes)), dtype=np.int64)
    most = random_network(x, int(sizes[-1]), t.shape[1], activation, rng)
    members = [np.flatnonzero(fold == f) for f in range(int(fold.max()) + 1)]
    grams, crosses = [], []
    for own in members:
        h = hidden_outputs(most, x[own])
        grams.append(h.T @ h)
        crosses.append(h.T @ t[own])
    gram, cross = np.sum(grams, axis=0), np.sum(crosses, axis=0)
    mse = np.zeros(len(sizes))
    for own, gram_f, cross_f in zip(members, grams, crosses, strict=True):
        for i, size in enumerate(sizes.tolist()):
            g, c = gram_f[:size, :size], cross_f[:size]
            beta = solve_output_weights(gram[:size, :size] - g, cross[:size] - c, len(x) - len(own), ridge)
            # |H_f β − T_f|² from the fold's own sums
            mse[i] += float(np.sum(beta * (g @ beta)) - 2.0 * np.sum(beta * c) + np.sum(t[own] ** 2))
    mse /= len(x)
    size = int(sizes[np.argmin(mse)])
    small = RegressionElm(activation, most.mean, most.scale, most.a[:, :size], most.b[:size], most.beta[:size])
    held_out = np.zeros_like(t)
    for own, gram_f, cross_f in zip(members, grams, crosses, strict=True):
        rest = solve_output_weights((gram - gram_f)[:size, :size], (cross - cross_f)[:size], len(x) - len(own), ridge)
        held_out[own] = hidden_outputs(small, x[own]) @ rest
    beta = solve_output_weights(gram[:size, :size], cross[:size], len(x), ridge)
    return CrossValidatedElm(
        RegressionElm(activation, small.mean, small.scale, small.a, small.b, beta), sizes, mse, held_out
    )
