"""A small mixture of Gaussians fitted to the draws of Markov chains."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.gaussians.gaussian import diagonal, inverse_root
from poseppl.gaussians.mixture import GaussianMixture, log_mixture_terms
from poseppl.gaussians.weighted_em import fit_from

_EM_STEPS = 10
_FLOOR = 1e-4
"""Share of the variances within chains that covariances are given besides: few draws may leave none in some direction."""
_MIN = 1e-20
"""Variance of a coordinate that is the same in all draws, as is what a transition makes of a state that it forgets."""


class Fitted(NamedTuple):
    """A mixture fitted to draws.

    Attributes:
        mixture: The mixture.
        residuals: Each draw less the mean of the component that it comes from, in the shape of the draws.
    """

    mixture: GaussianMixture
    residuals: Array


def fit_mixture(chains: Array, num_components: int, log_weights: Array | None = None) -> Fitted:
    """Fit K Gaussians to draws of M chains by expectation maximisation.

    Chains seldom cross from one mode of a posterior to another. So modes appear as chains whose means lie far apart in units
    of the covariance within chains. Components start at the means of K chains, each of which is the
    farthest from those before it. A component of few draws has no covariance of its own: each is shrunk towards that within
    chains by one pseudo-draw a dimension.

    Args:
        chains: Draws (M, R, d).
        num_components: K, at most M are used; one is the sample mean and covariance.
        log_weights: Weights of the chains (M,); None: all weigh the same.
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
    floor = jnp.maximum(_FLOOR * diagonal(within), _MIN)
    within = within + jnp.diag(floor)
    seeds = centres[_far_apart(centres, within, min(num_components, chains.shape[0]))]
    start = GaussianMixture(
        jnp.full(len(seeds), -jnp.log(float(len(seeds))), draws.dtype),
        seeds,
        jnp.broadcast_to(within, (len(seeds), dimension, dimension)),
    )
    mixture = fit_from(start, draws, weights, within, _EM_STEPS, floor)
    shares = jax.nn.softmax(jax.vmap(log_mixture_terms(mixture))(draws), axis=1)
    return Fitted(mixture, chains - (shares @ mixture.means).reshape(chains.shape))


def _far_apart(points: Array, covariance: Array, number: int) -> Array:
    """Indices of points (M, d): the one farthest from the mean, and then each the farthest from those before it."""
    white = (points - jnp.mean(points, 0)) @ inverse_root(covariance).T

    def choose(carry: tuple[Array, Array], _: None) -> tuple[tuple[Array, Array], Array]:
        nearest, index = carry
        nearest = jnp.minimum(nearest, jnp.sum((white - white[index]) ** 2, 1))
        return (nearest, jnp.argmax(nearest)), index

    first = jnp.argmax(jnp.sum(white**2, 1))
    _, chosen = jax.lax.scan(choose, (jnp.full(len(white), jnp.inf, white.dtype), first), None, length=number)
    return chosen
