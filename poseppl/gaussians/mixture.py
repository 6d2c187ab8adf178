"""Gaussians and small mixtures of them, fitted to draws."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.linalg import solve_triangular

_EM_STEPS = 10


class GaussianMixture(NamedTuple):
    """K Gaussians: ``log_weights`` (K,), -inf if empty, ``means`` (K, d), ``covariances`` (K, d, d), or (1, d, d) for all."""

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


def mixture_curvature(mixture: GaussianMixture) -> Callable[[jax.Array], jax.Array]:
    """Return a positive definite curvature (d, d) of the negative log-density at one state.

    It is the components' precisions, each by the probability that the state comes from it. The Hessian has one term more, which
    between components may make it indefinite; with one component they are the same.
    """
    precisions = jnp.linalg.inv(mixture.covariances)
    if precisions.shape[0] == 1:
        return lambda x: precisions[0]
    terms = log_mixture_terms(mixture)
    return lambda x: jnp.tensordot(jax.nn.softmax(terms(x)), precisions, 1)


def draw_mixture(rng_key: jax.Array, mixture: GaussianMixture, num_draws: int) -> tuple[jax.Array, jax.Array]:
    """Draw states (N, d) and tell which component each came from (N,)."""
    key_component, key_noise = jax.random.split(rng_key)
    component = jax.random.categorical(key_component, mixture.log_weights, shape=(num_draws,))
    noise = jax.random.normal(key_noise, (num_draws, mixture.means.shape[1]), mixture.means.dtype)
    lower = jnp.linalg.cholesky(mixture.covariances)
    return mixture.means[component] + jnp.einsum("nij,nj->ni", lower[component], noise), component


class Fitted(NamedTuple):
    """A mixture fitted to draws.

    Attributes:
        mixture: The mixture.
        residuals: Each draw less the mean of the component that it comes from, in the shape of the draws.
    """

    mixture: GaussianMixture
    residuals: jax.Array


def fit_mixture(chains: jax.Array, num_components: int, log_weights: jax.Array | None = None) -> Fitted:
    """Fit K Gaussians to draws of M chains by expectation maximisation.

    Chains seldom cross from one mode of a posterior to another, so modes show as chains whose means lie far apart in units of
    the covariance within chains, in any number of dimensions. Components start at the means of K chains, each of which is the
    farthest from those before it. A component of few draws has no covariance of its own: each is shrunk towards that within
    chains by one pseudo-draw a dimension.

    Args:
        chains: Draws (M, R, d).
        num_components: K, at most M are used; one is the sample mean and covariance.
        log_weights: Of the chains (M,); None: all weigh the same.
    """
    draws = chains.reshape(-1, chains.shape[-1])
    number, dimension = draws.shape
    of_chains = jnp.zeros(len(chains), draws.dtype) if log_weights is None else log_weights
    weights = jnp.repeat(jax.nn.softmax(of_chains) / chains.shape[1], chains.shape[1])
    mean = weights @ draws
    covariance = (weights[:, None] * (draws - mean)).T @ (draws - mean) * (number / max(number - 1, 1))
    if min(num_components, chains.shape[0]) == 1:
        return Fitted(GaussianMixture(jnp.zeros(1, draws.dtype), mean[None], covariance[None]), chains - mean)
    ridge = dimension / number
    centres = jnp.mean(chains, 1)
    inside = (chains - centres[:, None]).reshape(-1, dimension)
    within = (inside.T @ inside / number + ridge * covariance) / (1 + ridge)
    seeds = centres[_far_apart(centres, within, min(num_components, chains.shape[0]))]

    def responsibilities(mixture: GaussianMixture) -> jax.Array:
        return jax.nn.softmax(jax.vmap(log_mixture_terms(mixture))(draws), axis=1)

    def update(mixture: GaussianMixture, _: None) -> tuple[GaussianMixture, None]:
        found = responsibilities(mixture)
        share = weights[:, None] * found
        mass = jnp.sum(share, 0) + 1e-6
        means = share.T @ draws / mass[:, None]
        offset = draws - means[:, None]
        scatter = jnp.einsum("nk,kni,knj->kij", share, offset, offset) / mass[:, None, None]
        own = (jnp.mean(found, 0) / (jnp.mean(found, 0) + ridge))[:, None, None]
        covariances = own * scatter + (1 - own) * within
        return GaussianMixture(jnp.log(mass / jnp.sum(mass)), means, covariances), None

    uniform = jnp.full(len(seeds), -jnp.log(float(len(seeds))), draws.dtype)
    start = GaussianMixture(uniform, seeds, jnp.broadcast_to(within, (len(seeds), dimension, dimension)))
    mixture, _ = jax.lax.scan(update, start, None, length=_EM_STEPS)
    return Fitted(mixture, chains - (responsibilities(mixture) @ mixture.means).reshape(chains.shape))


def _far_apart(points: jax.Array, covariance: jax.Array, number: int) -> jax.Array:
    """Indices of points (M, d): the one farthest from the mean, and then each the farthest from those before it."""
    precision = jnp.linalg.inv(covariance)

    def distance(centre: jax.Array) -> jax.Array:
        offset = points - centre
        return jnp.einsum("ni,ij,nj->n", offset, precision, offset)

    chosen = [jnp.argmax(distance(jnp.mean(points, 0)))]
    nearest = distance(points[chosen[0]])
    for _ in range(number - 1):
        chosen.append(jnp.argmax(nearest))
        nearest = jnp.minimum(nearest, distance(points[chosen[-1]]))
    return jnp.stack(chosen)


def log_mixture_terms(mixture: GaussianMixture) -> Callable[[jax.Array], jax.Array]:
    """Return the log-densities (K,) of the weighted components at one state."""
    single = [log_mixture(jax.tree.map(lambda leaf, k=k: leaf[k : k + 1], mixture)) for k in range(mixture.means.shape[0])]
    return lambda x: jnp.stack([log_density(x) for log_density in single])
