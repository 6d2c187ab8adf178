"""Gaussians and small mixtures of them, fitted to draws."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.linalg import solve_triangular

_EM_STEPS = 10


class GaussianMixture(NamedTuple):
    """K Gaussians: ``log_weights`` (K,), ``means`` (K, d), ``covariances`` (K, d, d)."""

    log_weights: jax.Array
    means: jax.Array
    covariances: jax.Array


def log_mixture(mixture: GaussianMixture) -> Callable[[jax.Array], jax.Array]:
    """Return the log-density of one state (d,); the factorisations are made here, once."""
    unit = 1.0 / jnp.sqrt(jnp.diagonal(mixture.covariances, axis1=1, axis2=2))
    lower = jnp.linalg.cholesky(mixture.covariances * unit[:, :, None] * unit[:, None, :])
    eye = jnp.broadcast_to(jnp.eye(lower.shape[-1], dtype=lower.dtype), lower.shape)
    whiten = solve_triangular(lower, eye, lower=True) * unit[:, None, :]
    log_det = jnp.sum(jnp.log(jnp.diagonal(whiten, axis1=1, axis2=2)), -1)
    constant = mixture.log_weights + log_det - 0.5 * mixture.means.shape[-1] * jnp.log(2 * jnp.pi)

    def log_density(x: jax.Array) -> jax.Array:
        white = jnp.einsum("kij,kj->ki", whiten, x - mixture.means)
        terms = constant - 0.5 * jnp.sum(white * white, -1)
        return terms[0] if terms.shape[0] == 1 else jax.nn.logsumexp(terms)

    return log_density


def draw_mixture(rng_key: jax.Array, mixture: GaussianMixture, num_draws: int) -> tuple[jax.Array, jax.Array]:
    """Draw states (N, d) and tell which component each came from (N,)."""
    key_component, key_noise = jax.random.split(rng_key)
    component = jax.random.categorical(key_component, mixture.log_weights, shape=(num_draws,))
    noise = jax.random.normal(key_noise, (num_draws, mixture.means.shape[1]), mixture.means.dtype)
    lower = jnp.linalg.cholesky(mixture.covariances)
    return mixture.means[component] + jnp.einsum("nij,nj->ni", lower[component], noise), component


def fit_mixture(rng_key: jax.Array, draws: jax.Array, num_components: int) -> GaussianMixture:
    """Fit K Gaussians to equally weighted draws by expectation maximisation, seeded at random draws.

    Args:
        rng_key: For the seeds; unused with one component, which is the sample mean and covariance.
        draws: Shape (N, d).
        num_components: K.
    """
    mean = jnp.mean(draws, 0)
    centred = draws - mean
    covariance = centred.T @ centred / max(draws.shape[0] - 1, 1)
    if num_components == 1:
        return GaussianMixture(jnp.zeros(1, draws.dtype), mean[None], covariance[None])
    seeds = jax.random.choice(rng_key, draws, (num_components,), replace=False)
    uniform = jnp.full(num_components, -jnp.log(float(num_components)), draws.dtype)
    # a component of few draws has no covariance of its own: shrink each towards the common one by one pseudo-draw a dimension
    ridge = draws.shape[1] / draws.shape[0]

    def update(mixture: GaussianMixture, _: None) -> tuple[GaussianMixture, None]:
        parts = jax.vmap(log_mixture_terms(mixture))(draws)
        share = jax.nn.softmax(parts, axis=1)
        mass = jnp.mean(share, 0) + 1e-6
        means = share.T @ draws / (mass[:, None] * draws.shape[0])
        offset = draws - means[:, None]
        scatter = jnp.einsum("nk,kni,knj->kij", share, offset, offset) / draws.shape[0]
        covariances = (scatter + ridge * covariance) / (mass + ridge)[:, None, None]
        return GaussianMixture(jnp.log(mass / jnp.sum(mass)), means, covariances), None

    start = GaussianMixture(uniform, seeds, jnp.broadcast_to(covariance, (num_components, *covariance.shape)))
    mixture, _ = jax.lax.scan(update, start, None, length=_EM_STEPS)
    return mixture


def log_mixture_terms(mixture: GaussianMixture) -> Callable[[jax.Array], jax.Array]:
    """Return the log-densities (K,) of the weighted components at one state."""
    single = [log_mixture(jax.tree.map(lambda leaf, k=k: leaf[k : k + 1], mixture)) for k in range(mixture.means.shape[0])]
    return lambda x: jnp.stack([log_density(x) for log_density in single])
