r"""Weighted sets of particles, with weights as logarithms, and how many independent draws a sample from few families is worth.

With log-weights \ell_i, normalised weights w_i = exp(\ell_i) / sum_j exp(\ell_j), and N of them,

    log-mean-exp = log (1/N) sum_i exp(\ell_i),        ESS = 1 / sum_i w_i^2   (between 1 and N).

A NaN log-weight counts as weight zero. When no weight is left (all -inf or NaN, or one is +inf) the set is *degenerate*:
nothing can be said from it, weights fall back to uniform and the flag says so; there is never a NaN in a result.

Resampled particles are copies, which moves have to draw apart. Particles that descend from one draw are a family; where moves
have forgotten it, members are as different as any two particles, and families have alike means. With masses w_a of the F
families, of N equally weighted particles, and a total variance of 1, of which the families' means have the share b,

    E[1 - b] = s^2 (1 - F / N),        E[b] = s_f^2 (1 - sum w_a^2) + s^2 (F - 1) / N

give the variances s^2 within families and s_f^2 between them (Searle, Casella and McCulloch 1992, chapter 4, of one random
factor), and the sample's mean errs by s_f^2 sum w_a^2 + s^2 / N times the sample's own variance: the effective number is its
inverse (Kish 1965, section 5.4). It is N of particles that have forgotten their ancestors, and 1 / sum w_a^2 - 1 of copies.
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


def clustered_ess(particles: Array, families: Array) -> Array:
    """Effective number of equally weighted particles, between 1 and N, on average over their coordinates.

    Args:
        particles: (N, d).
        families: The family of each (N,), from 0 to N - 1. The likeness within a single family is unknown: it counts as 1.

    Example:
        >>> alike = jnp.array([[0.0], [0.0], [1.0], [1.0], [2.0], [2.0], [3.0], [3.0]])
        >>> round(float(clustered_ess(alike, jnp.array([0, 0, 1, 1, 2, 2, 3, 3]))), 3)
        3.0
    """
    count = particles.shape[0]
    mass = jnp.zeros(count, particles.dtype).at[families].add(1 / count)
    number, squares = jnp.sum(mass > 0), jnp.sum(mass**2)
    spread = jnp.std(particles, 0)
    white = (particles - jnp.mean(particles, 0)) / jnp.where(spread > 0, spread, 1.0)
    centres = jnp.zeros_like(white).at[families].add(white / count) / jnp.maximum(mass, 1 / count)[:, None]
    between = jnp.sum(mass @ centres**2) / jnp.maximum(jnp.sum(spread > 0), 1)
    within = (1 - between) / jnp.maximum(1 - number / count, 1 / count)
    alike = jnp.maximum(between - within * (number - 1) / count, 0.0) / jnp.maximum(1 - squares, 1 / count)
    return jnp.where(number == 1, 1.0, 1 / jnp.clip(alike * squares + within / count, 1 / count, 1.0))
