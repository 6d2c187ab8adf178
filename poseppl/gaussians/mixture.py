"""Mixtures of Gaussians: density, curvature, draws."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp

from poseppl.gaussians.gaussian import inverse_root


class GaussianMixture(NamedTuple):
    """K Gaussians: ``log_weights`` (K,), -inf if empty, ``means`` (K, d), ``covariances`` (K, d, d), or (1, d, d) for all."""

    log_weights: jax.Array
    means: jax.Array
    covariances: jax.Array


def log_mixture_terms(mixture: GaussianMixture) -> Callable[[jax.Array], jax.Array]:
    """Return the log-densities (K,) of the weighted components at one state (d,); factorisations are made here, once."""
    whiten = jax.vmap(inverse_root)(mixture.covariances)
    log_det = jnp.sum(jnp.log(jnp.diagonal(whiten, axis1=1, axis2=2)), -1)
    constant = mixture.log_weights + log_det - 0.5 * mixture.means.shape[-1] * jnp.log(2 * jnp.pi)

    def log_densities(x: jax.Array) -> jax.Array:
        white = jnp.einsum("kij,kj->ki", whiten, x - mixture.means)
        return constant - 0.5 * jnp.sum(white * white, -1)

    return log_densities


def log_mixture(mixture: GaussianMixture) -> Callable[[jax.Array], jax.Array]:
    """Return the log-density of one state (d,)."""
    terms = log_mixture_terms(mixture)
    if mixture.means.shape[0] == 1:
        return lambda x: terms(x)[0]
    return lambda x: jax.nn.logsumexp(terms(x))


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
