r"""The covariance of a target, learned from all chains on the way, for the moves that they make next.

With the positions u_c of M chains after update k, and gamma_k = (k + 10)^(-0.6), or another decay,

    m <- m + gamma_k mean_c (u_c - m),        S <- S + gamma_k (mean_c (u_c - m)(u_c - m)^T - S)

(Andrieu and Thoms 2008, algorithm 4, doi:10.1007/s11222-008-9110-y). Learning ends with the warm-up, so that the draws which
count come from one Markov kernel.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

_OFFSET = 10.0
"""Keeps the first update, in which all chains may stand at one point, from taking everything."""
_RIDGE = 1e-4
"""Share of each variance that the diagonal keeps on top, so that a factorisation never fails."""
_SMALLEST = 1e-30


class AdaptiveCovariance(NamedTuple):
    """Learned mean and covariance of the target.

    Attributes:
        mean: m (p,).
        covariance: S (p, p).
    """

    mean: Array
    covariance: Array


def initial_covariance(draws: Array) -> AdaptiveCovariance:
    """Begin with the moments of rough draws (S, p), say of the prior; draws that are not finite are left out."""
    sound = jnp.all(jnp.isfinite(draws), 1, keepdims=True)
    count = jnp.maximum(jnp.sum(sound), 1)
    safe = jnp.where(sound, draws, 0.0)
    mean = jnp.sum(safe, 0) / count
    centred = jnp.where(sound, safe - mean, 0.0)
    variance = jnp.sum(centred**2, 0) / count
    return AdaptiveCovariance(mean, jnp.diag(jnp.where(variance > 0, variance, 1.0)))


def learn(known: AdaptiveCovariance, positions: Array, number: Array, decay: ArrayLike = 0.6) -> AdaptiveCovariance:
    """Take in the positions (M, p) of all chains after update `number`, counted from 0; decay 1 weighs all updates alike."""
    gain = (jnp.asarray(number, positions.dtype) + _OFFSET) ** -jnp.asarray(decay, positions.dtype)
    centred = positions - known.mean
    scatter = centred.T @ centred / positions.shape[0]
    mean = known.mean + gain * jnp.mean(centred, 0)
    return AdaptiveCovariance(mean, known.covariance + gain * (scatter - known.covariance))


def ridged(covariance: Array) -> Array:
    """The covariance (p, p) with a small ridge, positive definite."""
    return covariance + jnp.diag(_RIDGE * jnp.diagonal(covariance) + _SMALLEST)
