r"""Weighted sets of particles, with weights as logarithms.

With log-weights \ell_i, normalised weights w_i = exp(\ell_i) / sum_j exp(\ell_j), and N of them,

    log-mean-exp = log (1/N) sum_i exp(\ell_i),        ESS = 1 / sum_i w_i^2   (between 1 and N).

A NaN log-weight counts as weight zero. When no weight is left (all -inf or NaN, or one is +inf) the set is *degenerate*:
nothing can be said from it, weights fall back to uniform and the flag says so; there is never a NaN in a result.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from poseppl.compilation import with_full_precision


class Normalised(NamedTuple):
    """Normalised weights of one set.

    Attributes:
        log_weights: Their logarithms (N,).
        weights: The weights, which sum to one (N,).
        log_mean: Log of the mean unnormalised weight, a scalar; -inf when degenerate.
        degenerate: Whether no weight was positive and finite; `log_weights` are then uniform.
        ess: Effective number of particles in [1, N], a scalar; 0 when degenerate.
    """

    log_weights: Array
    weights: Array
    log_mean: Array
    degenerate: Array
    ess: Array


def nan_to_neg_inf(log_values: Array) -> Array:
    """Log-weights or log-densities of any shape, of which NaN counts as impossible."""
    return jnp.where(jnp.isnan(log_values), -jnp.inf, log_values)


def without_infinity(log_values: Array) -> Array:
    """Log-densities of any shape, of which NaN and +inf count as impossible."""
    return jnp.where(jnp.isposinf(log_values), -jnp.inf, nan_to_neg_inf(log_values))


def normalise(log_weights: Array) -> Normalised:
    """Normalise log-weights (N,).

    Example:
        >>> normalise(jnp.array([-5.0, -jnp.inf, -5.0])).weights.tolist()
        [0.5, 0.0, 0.5]
    """
    clean = nan_to_neg_inf(log_weights)
    peak = jnp.max(clean)
    degenerate = ~jnp.isfinite(peak)
    shifted = jnp.where(degenerate, 0.0, clean - jnp.where(degenerate, 0.0, peak))
    count = log_weights.shape[0]
    unnormalised = jnp.exp(shifted)
    total = jnp.sum(unnormalised)
    weights, log_sum = unnormalised / total, jnp.log(total)
    log_mean = jnp.where(degenerate, -jnp.inf, peak + log_sum - jnp.log(jnp.asarray(count, clean.dtype)))
    ess = jnp.where(degenerate, 0.0, 1.0 / jnp.sum(weights**2))
    return Normalised(shifted - log_sum, weights, log_mean, degenerate, ess)


class Weighed(NamedTuple):
    """Weights of one set after a frame's data.

    Attributes:
        log_weights: Normalised log-weights (N,); those before the data where these are impossible.
        log_evidence: Log of the sum of the weights before the data times the likelihoods, a scalar; -inf where impossible.
        ess: Effective number of particles, a scalar.
        failed: Whether no particle can explain the data.
    """

    log_weights: Array
    log_evidence: Array
    ess: Array
    failed: Array


def weigh(log_prior: Array, log_likelihoods: Array) -> Weighed:
    """Weigh particles by a frame's data.

    Args:
        log_prior: Log-weights before the data (N,): normalised, or such that their sum is one on average.
        log_likelihoods: Shape (N,).
    """
    updated = log_prior + log_likelihoods
    failed = ~jnp.isfinite(jnp.max(nan_to_neg_inf(updated)))
    posterior = normalise(jnp.where(failed, log_prior, updated))
    log_evidence = posterior.log_mean + jnp.log(jnp.asarray(log_prior.shape[0], log_prior.dtype))
    return Weighed(posterior.log_weights, jnp.where(failed, -jnp.inf, log_evidence), jnp.maximum(posterior.ess, 1.0), failed)


def effective_sample_size(log_weights: Array) -> Array:
    """Effective number 1 / sum w_i^2 of log-weights (N,), in [1, N]; 0 for a degenerate set."""
    return normalise(log_weights).ess


def weighted_mean(particles: Array, log_weights: Array) -> Array:
    """Mean (d,) of particles (N, d) with log-weights (N,); particles of zero weight are not read, whatever their values."""
    weights = normalise(log_weights).weights
    return weights @ _without_weightless(particles, weights)


@with_full_precision
def weighted_covariance(particles: Array, log_weights: Array) -> Array:
    """Covariance (d, d) of particles (N, d) with log-weights (N,): sum_i w_i (x_i - m)(x_i - m)^T, without correction."""
    weights = normalise(log_weights).weights
    safe = _without_weightless(particles, weights)
    centred = safe - weights @ safe
    return (centred * weights[:, None]).T @ centred


def _without_weightless(particles: Array, weights: Array) -> Array:
    return jnp.where(weights[:, None] > 0, particles, 0.0)
