"""Gaussian data of which some entries are missing: the density of those that were seen.

The marginal of a Gaussian is the Gaussian of the entries that are left. Let R be the covariance of the entries. Replace its
rows and columns of missing entries by those of the identity. The Cholesky factor of the result factorises that marginal,

    log p(z_seen) = sum over seen i of log p(z_i | seen z_j, j < i).
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpyro.distributions as dist
from jax import Array
from jax.scipy.linalg import solve_triangular


def seen_factor(covariance: Array, seen: Array) -> Array:
    """Lower factor (..., n, n) of a covariance (..., n, n), with missing entries replaced by independent ones of variance 1."""
    both = seen[..., :, None] & seen[..., None, :]
    lower: Array = jnp.linalg.cholesky(jnp.where(both, covariance, jnp.eye(seen.shape[-1], dtype=covariance.dtype)))
    return lower


def entry_log_densities(residual: Array, covariance: Array, seen: Array) -> Array:
    """Log-density (..., n) of each seen entry given the seen ones before it; 0 of the missing ones.

    Args:
        residual: Data less their mean (..., n).
        covariance: Theirs (..., n, n).
        seen: Which entries were seen (..., n).
    """
    lower = seen_factor(covariance, seen)
    white = solve_triangular(lower, jnp.where(seen, residual, 0.0)[..., None], lower=True)[..., 0]
    log_scale = jnp.log(jnp.diagonal(lower, axis1=-2, axis2=-1))
    return jnp.where(seen, -0.5 * white**2 - log_scale - 0.5 * jnp.log(2 * jnp.pi), 0.0)


def can_be_partly_seen(base: dist.Distribution) -> bool:
    """Whether a distribution, without its wrappers, has a density of some of its entries."""
    return type(base) is dist.MultivariateNormal


def is_partly_seen(mask: Array) -> Array:
    """Whether any event (..., n) was seen in part, a scalar."""
    return jnp.any(jnp.any(mask, -1) != jnp.all(mask, -1))


def partly_seen_log_densities(base: dist.MultivariateNormal, value: Array, mask: Array) -> Array:
    """Log-density (...,) of the seen entries of each event of a value (..., n); 0 where none was seen."""
    covariance = jnp.broadcast_to(base.covariance_matrix, (*value.shape, value.shape[-1]))
    return jnp.sum(entry_log_densities(value - base.loc, covariance, jnp.broadcast_to(mask, value.shape)), -1)


def whitening_factor(base: dist.MultivariateNormal, shape: tuple[int, ...], mask: Array | None) -> Array:
    """Lower factor (..., n, n) of the covariance of a value of this shape, of its seen entries where some are missing."""
    lower = jnp.broadcast_to(base.scale_tril, (*shape, shape[-1]))
    if mask is None or not can_be_partly_seen(base):
        return lower
    seen = jnp.broadcast_to(mask, shape)
    covariance = jnp.broadcast_to(base.covariance_matrix, lower.shape)
    factor: Array = jax.lax.cond(is_partly_seen(seen), lambda: seen_factor(covariance, seen), lambda: lower)
    return factor
