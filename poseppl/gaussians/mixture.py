r"""Mixtures of Gaussians, and of Gaussians whose covariance is itself an estimate: density, curvature, draws.

Take a Gaussian of which only the mean m and an unbiased covariance S of n independent draws are known. With the covariance
integrated out it has the density of Sellentin and Heavens 2016 (doi:10.1093/mnrasl/slv190), a multivariate t,

    p(x) proportional to (1 + q / (n - 1))^(-n / 2),    q = (x - m)^T S^-1 (x - m).

It is the Gaussian as n grows; for few draws it pulls less than S^-1 would, the less the farther out. Its factor here is the one
with which Laplace's integral at m is 1.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.gaussians.gaussian import diagonal, triangular_factors
from poseppl.particles.keys import normals_and_uniforms, weighted_choice


class GaussianMixture(NamedTuple):
    """K Gaussians: ``log_weights`` (K,), -inf if empty, ``means`` (K, d), ``covariances`` (K, d, d), or (1, d, d) for all."""

    log_weights: Array
    means: Array
    covariances: Array


class MixtureFactors(NamedTuple):
    """Triangular factors of a mixture's covariances: ``scales`` L_k and ``roots`` W_k = L_k^-1, (K or 1, d, d).

    Attributes:
        scales: L_k.
        roots: W_k.
        num_draws: Independent draws that the covariances are estimates from, a scalar; None: they are exact.
    """

    scales: Array
    roots: Array
    num_draws: Array | None


def factorise_mixture(mixture: GaussianMixture, num_draws: Array | None = None) -> MixtureFactors:
    """Factorise the covariances once, for the functions of this module that would each do it."""
    return MixtureFactors(*jax.vmap(triangular_factors)(mixture.covariances), num_draws)


def log_mixture_terms(mixture: GaussianMixture, factors: MixtureFactors | None = None) -> Callable[[Array], Array]:
    """Return the log-densities (K,) of the weighted components at one state (d,); factorisations are made here, once."""
    factors = factorise_mixture(mixture) if factors is None else factors
    squared_distances, number = _squared_distances(mixture, factors), factors.num_draws
    log_det = jnp.sum(jnp.log(diagonal(factors.roots)), -1)
    constant = mixture.log_weights + log_det - 0.5 * mixture.means.shape[1] * jnp.log(2 * jnp.pi)
    if number is None:
        return lambda x: constant - 0.5 * squared_distances(x)
    constant = constant + 0.5 * mixture.means.shape[1] * jnp.log(number / (number - 1.0))
    return lambda x: constant - 0.5 * number * jnp.log1p(squared_distances(x) / (number - 1.0))


def _squared_distances(mixture: GaussianMixture, factors: MixtureFactors) -> Callable[[Array], Array]:
    """Return the squared distances (K,) of one state (d,) from the means, each in units of its covariance."""
    number, dimension = mixture.means.shape
    # W_k (x - m_k) = W_k (x - m_1) - W_k (m_k - m_1), so that all components are one product of matrices
    roots = jnp.broadcast_to(factors.roots, (number, dimension, dimension))
    centre = mixture.means[0]
    shifts = jnp.einsum("kij,kj->ki", roots, mixture.means - centre)
    whiten = roots.reshape(number * dimension, dimension)

    def squared(x: Array) -> Array:
        white = (whiten @ (x - centre)).reshape(number, dimension) - shifts
        return jnp.sum(white * white, -1)

    return squared


def log_mixture(mixture: GaussianMixture, factors: MixtureFactors | None = None) -> Callable[[Array], Array]:
    """Return the log-density of one state (d,)."""
    terms = log_mixture_terms(mixture, factors)
    if mixture.means.shape[0] == 1:
        return lambda x: terms(x)[0]
    return lambda x: jax.nn.logsumexp(terms(x))


def mixture_curvature(mixture: GaussianMixture, factors: MixtureFactors | None = None) -> Callable[[Array], Array]:
    """Return a positive definite curvature (d, d) of the negative log-density at one state.

    It is the components' precisions, each by the probability that the state comes from it, and where covariances are estimates
    by n / (n - 1 + q), too. The Hessian has terms more, which between and far from components may make it indefinite; with one
    exact component they are the same.
    """
    factors = factorise_mixture(mixture) if factors is None else factors
    precisions, number = jnp.einsum("kji,kjl->kil", factors.roots, factors.roots), factors.num_draws
    if number is None and precisions.shape[0] == 1:
        return lambda x: precisions[0]
    terms, squared_distances = log_mixture_terms(mixture, factors), _squared_distances(mixture, factors)

    def curvature(x: Array) -> Array:
        pull = 1.0 if number is None else number / (number - 1.0 + squared_distances(x))
        return jnp.tensordot(jax.nn.softmax(terms(x)) * pull, precisions, 1)

    return curvature


def draw_mixture(
    rng_key: Array, mixture: GaussianMixture, num_draws: int, factors: MixtureFactors | None = None
) -> tuple[Array, Array]:
    """Draw states (N, d), with the component (N,) that each came from."""
    scales = (factorise_mixture(mixture) if factors is None else factors).scales
    noise, chances = normals_and_uniforms(rng_key, (num_draws,), mixture.means.shape[1], 1, mixture.means.dtype)
    component = weighted_choice(chances[:, 0], mixture.log_weights)
    return mixture.means[component] + jnp.einsum("nij,nj->ni", scales[component], noise), component
