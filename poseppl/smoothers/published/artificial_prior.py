r"""Gaussian summaries of a filter's history, from which an information filter takes its artificial priors and its proposals.

For each frame t < T - 1 one successor y_i ~ p(x_(t+1) | x_t^i) is drawn for each particle. The pairs (x_t^i, y_i), weighted by
w_t^i, give means m, m' and covariances P, P' and C = cov(x_t, y):

    gamma_(t+1) = N(m', c P'),                            the artificial prior of the next frame: about what the filter
    predicts q(x_t | y)  = N(m + G (y - m'), c (P - G C^T)),       G = C P'^-1, the regression of a state on its successor,

both widened by the factor c. A Gaussian model's exact backward kernel, given the data up to t, is q with c = 1. Covariances
are kept positive by a small part of P', so that particles that are all equal do no harm.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array
from jax.scipy.linalg import cho_solve

from poseppl.gaussians.gaussian import Factorised, factorise
from poseppl.particles.keys import particle_keys
from poseppl.particles.weights import weighted_covariance, weighted_mean
from poseppl.program import CompiledModel
from poseppl.program.population import propagate

_FLOOR = 1e-3
"""Part of the predicted variances that every covariance has at least."""


class Regression(NamedTuple):
    """A state given its successor y: residual.mean + gain (y - next_mean) + a draw of residual less its mean."""

    residual: Factorised
    next_mean: Array
    gain: Array

    def draw(self, rng_key: Array, successors: Array) -> tuple[Array, Array]:
        """Draw states (N, d) given successors (N, d), with the log-densities (N,) of the draws."""
        drawn, log_density = self.residual.draw(rng_key, successors.shape[0])
        return drawn + (successors - self.next_mean) @ self.gain.T, log_density


def pair_moments(
    model: CompiledModel, rng_key: Array, particles: Array, log_weights: Array, inputs: Any
) -> tuple[Array, Array]:
    """Mean (2 d,) and covariance (2 d, 2 d) of a frame's particles (N, d), each beside a successor drawn for it."""
    keys = particle_keys(rng_key, particles.shape[0])
    successors = propagate(model, keys, particles, inputs)
    pairs = jnp.concatenate([particles, successors], 1)
    return weighted_mean(pairs, log_weights), weighted_covariance(pairs, log_weights)


def summarise(mean: Array, covariance: Array, inflation: float) -> tuple[Factorised, Regression]:
    """The artificial prior of the next frame, and the regression of this frame's state on it.

    Args:
        mean: Mean (2 d,) of a state and its successor.
        covariance: Their covariance (2 d, 2 d).
        inflation: c.
    """
    d = mean.shape[0] // 2
    floor = floor_of(covariance[d:, d:], mean[d:])
    predicted, cross = covariance[d:, d:] + floor, covariance[:d, d:]
    gain = cho_solve((jnp.linalg.cholesky(predicted), True), cross.T).T
    residual = covariance[:d, :d] - gain @ cross.T
    residual = inflation * (residual + residual.T) / 2 + floor
    return factorise(mean[d:], inflation * predicted), Regression(factorise(mean[:d], residual), mean[d:], gain)


def floor_of(covariance: Array, mean: Array) -> Array:
    """A small diagonal matrix (d, d) for a covariance to stay positive: of its own variances, and of the digits of the mean."""
    digits = float(jnp.finfo(mean.dtype).eps)  # type: ignore[no-untyped-call]
    return jnp.diag(_FLOOR * jnp.diagonal(covariance) + digits * (1.0 + mean**2))
