"""Rational functions through samples of several quantities that share their poles: the AAA algorithm.

Nakatsukasa, Sète & Trefethen 2018, SIAM J. Sci. Comput. 40, A1494; for several functions at once with the same weights:
Lietaert et al. 2022, IMA J. Numer. Anal. 42, 1087. With support points z_j, values f_j there and weights w_j,

    r(z) = Σ_j w_j f_j / (z − z_j)  /  Σ_j w_j / (z − z_j).

Support points are taken one by one where the error is largest; the weights are the vector that makes r the best fit of
the other samples in the least squares of the numerators. SciPy's AAA takes one function.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigvals

from beamrider.arrays import Complexes, Floats

# Support points taken without an improvement before the best function so far is taken: what is left is rounding.
_PATIENCE = 8
_SUM = 1e-13  # functions of this share of the largest are sums of others but for rounding


@dataclass(frozen=True)
class Rational:
    """Support points z (m), values (k, m) there, weights (m), and the largest error at the samples it was made of."""

    z: Floats
    values: Floats
    weights: Floats
    error: float

    def __call__(self, at: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """The k functions (k, n) at points (n), real or complex."""
        apart = at[:, None] - self.z
        hit, support = np.nonzero(apart == 0.0)
        apart[hit] = 1.0
        kernel = self.weights / apart
        out = (self.values @ kernel.T) / kernel.sum(axis=1)
        out[:, hit] = self.values[:, support]
        return np.asarray(out)

    def poles(self) -> tuple[Complexes, Complexes]:
        """Poles (p) and the residues there (k, p)."""
        m = self.z.size
        left = np.zeros((m + 1, m + 1))
        left[0, 1:], left[1:, 0] = self.weights, 1.0
        left[1:, 1:] = np.diag(self.z)
        found = eigvals(left, np.diag(np.append(0.0, np.ones(m))))
        found = found[np.isfinite(found)]
        # A pole that is hit by a support point is none of the function.
        found = found[(found[:, None] != self.z).all(axis=1)]
        kernel = self.weights / (found[:, None] - self.z)
        slope = -(kernel / (found[:, None] - self.z)).sum(axis=1)
        return found, (self.values @ kernel.T) / slope


def fit(z: Floats, f: Floats, tolerance: float, most: int) -> Rational:
    """A rational function of at most `most` − 1 poles through samples f (k, n) at real z (n) within `tolerance`.

    Where `most`, the number of samples or rounding ends it, its `error` is larger.
    """
    n = z.size
    rest = np.ones(n, bool)
    guess = np.repeat(f.mean(axis=1, keepdims=True), n, axis=1)
    # As least squares see them, the functions are a few, which the others are sums of.
    _, sizes, few = np.linalg.svd(f, full_matrices=False)
    few = (sizes[:, None] * few)[sizes >= _SUM * sizes[0]]
    best = Rational(z[:1], f[:, :1], np.ones(1), np.inf)
    chosen: list[int] = []
    for _ in range(min(most, (n + 1) // 2)):
        worst = int(np.abs(f - guess).max(axis=0).argmax())
        chosen.append(worst)
        rest[worst] = False
        cauchy = 1.0 / (z[rest, None] - z[chosen])
        loewner = ((few[:, rest, None] - few[:, None, chosen]) * cauchy).reshape(-1, len(chosen))
        weights = _smallest(loewner)
        guess = np.array(f)
        guess[:, rest] = (f[:, chosen] * weights @ cauchy.T) / (cauchy @ weights)
        error = float(np.abs(f - guess).max())
        if error < best.error:
            best = Rational(z[chosen], f[:, chosen], weights, error)
        if error <= tolerance or len(chosen) > best.z.size + _PATIENCE:
            break
    return best


def _smallest(matrix: Floats) -> Floats:
    """The unit vector that the matrix makes smallest."""
    _, _, right = np.linalg.svd(np.linalg.qr(matrix, mode="r"))
    return np.asarray(right[-1])
