"""The marginal of each coordinate, known without draws: a mixture of Gaussians, coordinate by coordinate.

A Kalman filter knows one Gaussian, a switching filter one for each value of its finite site, a Rao-Blackwellised particle
filter one for each particle. Means, standard deviations and quantiles of these have no Monte Carlo error of draws. Finite
values are Gaussians without variance.

>>> one = Marginals(jnp.zeros(1), jnp.array([[2.0]]), jnp.array([[9.0]]))
>>> print(one.mean, one.standard_deviation, one.quantiles(jnp.array([0.5, 0.95])).round(2).ravel())
[2.] [3.] [2.   6.93]
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jax.scipy.special import ndtr, ndtri

_HALVINGS = 40
"""Iterations on the bracket of a quantile: beyond the precision of float32."""


class Marginals(NamedTuple):
    """A mixture of K Gaussians of d coordinates, whose correlations are left out.

    Attributes:
        log_weights: Normalised log-weights (K,).
        means: Means (K, d).
        variances: Variances (K, d), at least 0.
    """

    log_weights: Array
    means: Array
    variances: Array

    @property
    def mean(self) -> Array:
        """Means of the mixture (d,)."""
        weights, means, _ = self._weighty()
        return weights @ means

    @property
    def standard_deviation(self) -> Array:
        """Standard deviations of the mixture (d,)."""
        weights, means, variances = self._weighty()
        return jnp.sqrt(weights @ (variances + jnp.square(means - weights @ means)))

    def quantiles(self, levels: Array) -> Array:
        """Quantiles (levels, d): between those of its Gaussians, found by bisection where these are several."""
        weights, means, variances = self._weighty()
        deviations = jnp.sqrt(variances)
        wanted = levels.astype(means.dtype)[:, None]
        each = means[:, None] + ndtri(wanted) * deviations[:, None]
        if len(weights) == 1:
            return each[0]

        def share_below(x: Array) -> Array:
            apart = x - means[:, None]
            spread = jnp.where(deviations > 0, deviations, 1.0)[:, None]
            below = jnp.where(deviations[:, None] > 0, ndtr(apart / spread), apart >= 0)
            return jnp.tensordot(weights, below, 1)

        def halve(_: int, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
            low, high = bracket
            middle = (low + high) / 2
            enough = share_below(middle) >= wanted
            return jnp.where(enough, low, middle), jnp.where(enough, middle, high)

        _, found = jax.lax.fori_loop(0, _HALVINGS, halve, (jnp.min(each, 0), jnp.max(each, 0)))
        nearest = jnp.argmin(jnp.abs(found - means[:, None]), 0)
        finite = jnp.take_along_axis(means, nearest, 0)
        return jnp.where(jnp.all(variances == 0, 0), finite, found)

    def _weighty(self) -> tuple[Array, Array, Array]:
        """Weights, means and variances, with those of no weight, which may be anything, set to the weightiest."""
        weights = jnp.exp(self.log_weights)
        likeliest, counts = jnp.argmax(weights), (weights > 0)[:, None]
        means, variances = (jnp.where(counts, each, each[likeliest]) for each in (self.means, self.variances))
        return weights, means, variances


def gaussian_marginals(mean: Array, covariance: Array) -> Marginals:
    """Those of one Gaussian, of mean (..., d) and covariance (..., d, d)."""
    variances = jnp.maximum(jnp.diagonal(covariance, axis1=-2, axis2=-1), 0.0)
    return Marginals(jnp.zeros((*mean.shape[:-1], 1), mean.dtype), mean[..., None, :], variances[..., None, :])
