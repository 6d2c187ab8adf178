"""Mixtures of Gaussians: density, curvature, draws."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp

from poseppl.gaussians.gaussian import diagonal, triangular_factors
from poseppl.particles.random_numbers import normals_and_uniforms, weighted_choice


class GaussianMixture(NamedTuple):
    """K Gaussians: ``log_weights`` (K,), -inf if empty, ``means`` (K, d), ``covariances`` (K, d, d), or (1, d, d) for all."""

    log_weights: jax.Array
    means: jax.Array
    covariances: jax.Array


class MixtureFactors(NamedTuple):
    """Triangular factors of a mixture's covariances: ``scales`` L_k and ``roots`` W_k = L_k^-1, (K or 1, d, d)."""

    scales: jax.Array
    roots: jax.Array


def factorise_mixture(mixture: GaussianMixture) -> MixtureFactors:
    """Factorise the covariances once, for the functions of this module that would each do it."""
    return MixtureFactors(*jax.vmap(triangular_factors)(mixture.covariances))


def log_mixture_terms(mixture: GaussianMixture, factors: MixtureFactors | None = None) -> Callable[[jax.Array], jax.Array]:
    """Return the log-densities (K,) of the weighted components at one state (d,); factorisations are made here, once."""
    number, dimension = mixture.means.shape
    roots = (factorise_mixture(mixture) if factors is None else factors).roots
    log_det = jnp.sum(jnp.log(diagonal(roots)), -1)
    constant = mixture.log_weights + log_det - 0.5 * dimension * jnp.log(2 * jnp.pi)
    # W_k (x - m_k) = W_k (x - m_1) - W_k (m_k - m_1), so that all components are one product of matrices
    roots = jnp.broadcast_to(roots, (number, dimension, dimension))
    centre = mixture.means[0]
    shifts = jnp.einsum("kij,kj->ki", roots, mixture.means - centre)
    whiten = roots.reshape(number * dimension, dimension)

    def log_densities(x: jax.Array) -> jax.Array:
        white = (whiten @ (x - centre)).reshape(number, dimension) - shifts
        return constant - 0.5 * jnp.sum(white * white, -1)

    return log_densities


def log_mixture(mixture: GaussianMixture, factors: MixtureFactors | None = None) -> Callable[[jax.Array], jax.Array]:
    """Return the log-density of one state (d,)."""
    terms = log_mixture_terms(mixture, factors)
    if mixture.means.shape[0] == 1:
        return lambda x: terms(x)[0]
    return lambda x: jax.nn.logsumexp(terms(x))


def mixture_curvature(mixture: GaussianMixture, factors: MixtureFactors | None = None) -> Callable[[jax.Array], jax.Array]:
    """Return a positive definite curvature (d, d) of the negative log-density at one state.

    It is the components' precisions, each by the probability that the state comes from it. The Hessian has one term more, which
    between components may make it indefinite; with one component they are the same.
    """
    factors = factorise_mixture(mixture) if factors is None else factors
    precisions = jnp.einsum("kji,kjl->kil", factors.roots, factors.roots)
    if precisions.shape[0] == 1:
        return lambda x: precisions[0]
    terms = log_mixture_terms(mixture, factors)
    return lambda x: jnp.tensordot(jax.nn.softmax(terms(x)), precisions, 1)


def draw_mixture(
    rng_key: jax.Array, mixture: GaussianMixture, num_draws: int, factors: MixtureFactors | None = None
) -> tuple[jax.Array, jax.Array]:
    """Draw states (N, d) and tell which component each came from (N,)."""
    scales = (factorise_mixture(mixture) if factors is None else factors).scales
    noise, chances = normals_and_uniforms(rng_key, (num_draws,), mixture.means.shape[1], 1, mixture.means.dtype)
    component = weighted_choice(chances[:, 0], mixture.log_weights)
    return mixture.means[component] + jnp.einsum("nij,nj->ni", scales[component], noise), component
