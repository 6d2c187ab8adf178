r"""Gaussian mixtures fitted to weighted points by expectation maximisation.

Eqs. 18 to 21 of Peursum, Venkatesh and West 2010 (doi:10.1007/s11263-009-0205-5). With points x_i of normalised weights rho_i,
a round makes from components (eta_k, m_k, R_k)

    tau_ik = rho_i eta_k N(x_i; m_k, R_k) / sum_j eta_j N(x_i; m_j, R_j),        eta_k' = sum_i tau_ik,
    m_k' = sum_i tau_ik x_i / eta_k',        R_k' = sum_i tau_ik (x_i - m_k') (x_i - m_k')^T / eta_k',

as if there were rho_i worth of points at x_i. Fixed covariances leave the last out. GaussianMixture are seeded at points whose
weight is at or above the average; there are at most K of them, chosen evenly among these when there are more, and where there
are fewer the others stay empty (eta = 0), so that shapes are static.

A covariance of few points collapses: free ones are shrunk towards that of all points by d pseudo-points for the effective
number of points in all. With one component this changes nothing: it is the weighted mean and covariance.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.gaussians.mixture import GaussianMixture, log_mixture_terms
from poseppl.particles.weights import weighted_covariance

_KEPT = 1e-6
"""Share of a component that its old mean counts for: an empty one stays where it is."""


def choose_seeds(rng_key: Array, log_weights: Array, num_components: int) -> tuple[Array, Array]:
    """Indices (K,) of particles at or above the average weight, and which of them count (K,).

    Args:
        rng_key: For the choice among more than K of them.
        log_weights: Normalised (N,).
        num_components: K; more than N are filled up with empty ones.
    """
    count = log_weights.shape[0]
    above = log_weights >= -jnp.log(jnp.asarray(count, log_weights.dtype)) - 1e-4
    order = jnp.where(above, jax.random.uniform(rng_key, (count,), log_weights.dtype), -1.0)
    place, index = jax.lax.top_k(order, min(num_components, count))
    missing = num_components - index.shape[0]
    return jnp.pad(index, (0, missing)), jnp.pad(place >= 0, (0, missing))


def fit_fixed(points: Array, weights: Array, seeds: Array, alive: Array, scales: Array, num_steps: int) -> GaussianMixture:
    """Fit weights and means of components that share one diagonal covariance.

    Args:
        points: Shape (N, d), near the origin in units in which their spread is about 1.
        weights: Normalised (N,).
        seeds: Indices of the points that the components start from (K,).
        alive: Which of the components there are (K,).
        scales: Standard deviations of a component (d,).
        num_steps: Rounds.
    """
    white = points / scales

    def update(state: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], None]:
        log_weights, means = state
        logits = white @ means.T + log_weights - 0.5 * jnp.sum(means**2, -1)
        return _update_means(weights, logits, white, means), None

    (log_weights, means), _ = jax.lax.scan(update, (_start(weights, seeds, alive), white[seeds]), None, length=num_steps)
    return GaussianMixture(log_weights, means * scales, jnp.diag(scales**2)[None])


def fit_free(points: Array, weights: Array, seeds: Array, alive: Array, num_steps: int, floor: Array) -> GaussianMixture:
    """Fit weights, means and covariances; arguments as in :func:`fit_fixed`, and the least variances (d,)."""
    common = weighted_covariance(points, jnp.log(weights)) + jnp.diag(floor)
    covariances = jnp.broadcast_to(common, (seeds.shape[0], *common.shape))
    start = GaussianMixture(_start(weights, seeds, alive), points[seeds], covariances)
    return fit_from(start, points, weights, common, num_steps, floor)


def fit_from(
    start: GaussianMixture, points: Array, weights: Array, common: Array, num_steps: int, floor: Any = 0.0
) -> GaussianMixture:
    """Fit weights, means and covariances of a mixture that is there.

    Args:
        start: The mixture.
        points: Shape (N, d).
        weights: Normalised (N,).
        common: The covariance (d, d) that those of few points are shrunk to.
        num_steps: Rounds.
        floor: Variances (d,) that are added to all covariances.
    """
    ridge = points.shape[1] * jnp.sum(weights**2)
    least = jnp.diag(jnp.broadcast_to(jnp.asarray(floor, points.dtype), points.shape[1:]))

    def update(state: GaussianMixture, _: None) -> tuple[GaussianMixture, None]:
        logits = jax.vmap(log_mixture_terms(state))(points)
        share = weights[:, None] * jax.nn.softmax(logits, axis=1)
        log_weights, means = _update_means(weights, logits, points, state.means)
        offset = points - means[:, None]
        scatter = jnp.einsum("nk,kni,knj->kij", share, offset, offset)
        mass = jnp.exp(log_weights)[:, None, None]
        covariances = (scatter + least * mass + ridge * common) / (mass + ridge)
        return GaussianMixture(log_weights, means, covariances), None

    fitted, _ = jax.lax.scan(update, start, None, length=num_steps)
    return fitted


def _start(weights: Array, seeds: Array, alive: Array) -> Array:
    """Log-weights (K,) in proportion to the seeds' own."""
    chosen = jnp.where(alive, weights[seeds], 0.0)
    return jnp.log(chosen / jnp.sum(chosen))


def _update_means(weights: Array, logits: Array, points: Array, means: Array) -> tuple[Array, Array]:
    """Eqs. 18 to 20: log-weights (K,) and means (K, d)."""
    share = weights[:, None] * jax.nn.softmax(logits, axis=1)
    mass = jnp.sum(share, 0)
    moved = share.T @ points
    kept = _KEPT / weights.shape[0]
    means = jnp.where(mass[:, None] > kept, moved / jnp.maximum(mass, kept)[:, None], means)
    return jnp.log(mass / jnp.sum(mass)), means
