r"""Autoregressive errors beside independent ones, marginalised: what data weigh whose errors last.

Data in M series of pairs are r_t = a_t + ratio e_t + u_t. The errors e_t = kept_t e_(t-1) + ... are stationary with variance 1
and have the precision Q. The errors u_t have the precision G_t (2, 2), 0 where the datum is missing. Given a, the series are
independent. So

    P = (G^-1 + ratio^2 Q^-1)^-1 = G - ratio^2 G (Q + ratio^2 G)^-1 G

is what a is known by, which costs O(T) a series: Q + ratio^2 G is banded, and missing data need no care. Arrays of N columns
are (N, M, T, 2).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from poseppl.arrays import Floats
from poseppl.gaussians.walk_chains import ar1_chains


class AR1Errors(NamedTuple):
    """Errors of M series of pairs over T frames.

    Attributes:
        own: Factor of a frame's e in its whitened innovation (T, 1).
        before: Factor of the e of the frame before (T, 1).
        ratio: Standard deviation of what lasts, in units of the data.
        weight: G, symmetric (M, T, 2, 2).
        factor: Banded Cholesky factor of Q + ratio^2 G.
    """

    own: Floats
    before: Floats
    ratio: float
    weight: Floats
    factor: Floats

    def solve(self, z: Floats) -> Floats:
        """(Q + ratio^2 G)^-1 z."""
        flat = z.reshape(len(z), -1)
        return np.asarray(cho_solve_banded((self.factor, True), flat.T, check_finite=False).T.reshape(z.shape))

    def weigh(self, z: Floats) -> Floats:
        """G z."""
        return times_pairs(self.weight, z)

    def precision(self, z: Floats) -> Floats:
        """P z."""
        weighed = self.weigh(z)
        return weighed - self.ratio**2 * self.weigh(self.solve(weighed))

    def prior(self, e: Floats) -> Floats:
        """Q e."""
        return self.pulled(self.innovations(e))

    def innovations(self, e: Floats) -> Floats:
        """F e, whose square is that of Q."""
        found = self.own * e
        found[..., 1:, :] -= self.before[1:] * e[..., :-1, :]
        return found

    def pulled(self, w: Floats) -> Floats:
        """F^T w."""
        found = self.own * w
        found[..., :-1, :] -= self.before[1:] * w[..., 1:, :]
        return found


def ar1_errors(kept: Floats, ratio: float, weight: Floats) -> AR1Errors:
    """Factorise what is needed of errors.

    Args:
        kept: (T,), what is left of them from the frame before; the first is not read.
        ratio: Standard deviation of what lasts, in units of the data.
        weight: G, symmetric and positive semi-definite (M, T, 2, 2).
    """
    chain = ar1_chains(kept, 1.0, 1)
    own, before = chain.own, chain.before
    diagonal = own[:, 0] ** 2
    diagonal[:-1] += before[1:, 0] ** 2
    banded = np.zeros((3, *weight.shape[:-1]))
    banded[0] = diagonal[:, None] + ratio**2 * np.diagonal(weight, axis1=-2, axis2=-1)
    banded[1, ..., 0] = ratio**2 * weight[..., 0, 1]
    banded[2, :, :-1] = -(own * before)[1:]
    factor = cholesky_banded(banded.reshape(3, -1), lower=True, check_finite=False)
    return AR1Errors(own, before, ratio, weight, factor)


def times_pairs(matrices: Floats, pairs: Floats) -> Floats:
    """Products (N, M, T, 2) of symmetric matrices (M, T, 2, 2) with pairs (N, M, T, 2).

    A pair is a complex number z, of which a symmetric matrix makes a z + b conj(z).
    """
    half = np.trace(matrices, axis1=-2, axis2=-1) / 2
    turned = (matrices[..., 0, 0] - matrices[..., 1, 1]) / 2 + 1j * matrices[..., 0, 1]
    z = np.ascontiguousarray(pairs).view(np.complex128)[..., 0]
    found = np.conj(z)
    found *= turned
    found += half * z
    return found[..., None].view(np.float64)


def root_of_pairs(matrices: Floats) -> Floats:
    """Symmetric square roots of positive semi-definite matrices (..., 2, 2)."""
    det = np.sqrt(np.maximum(np.linalg.det(matrices), 0.0))[..., None, None]
    size = np.trace(matrices, axis1=-2, axis2=-1)[..., None, None] + 2 * det
    return np.asarray((matrices + det * np.eye(2)) / np.sqrt(np.where(size > 0, size, 1.0)))
