"""One Gaussian: its moments, its factors, its precision."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import solve_triangular


class Gaussian(NamedTuple):
    """A mean (..., d) and a covariance (..., d, d)."""

    mean: jax.Array
    covariance: jax.Array


class Factorised(NamedTuple):
    """A Gaussian with its factors, made once: mean (d,), scale = Cholesky factor (d, d), its inverse, and log |scale|."""

    mean: jax.Array
    scale: jax.Array
    whiten: jax.Array
    log_scale: jax.Array

    def log_density(self, xs: jax.Array) -> jax.Array:
        """Log-densities (N,) of states (N, d)."""
        return self._of_white((xs - self.mean) @ self.whiten.T)

    def draw(self, rng_key: jax.Array, num: int) -> tuple[jax.Array, jax.Array]:
        """Draw states (N, d), with their log-densities (N,)."""
        white = jax.random.normal(rng_key, (num, self.mean.shape[-1]), self.mean.dtype)
        return self.mean + white @ self.scale.T, self._of_white(white)

    def _of_white(self, white: jax.Array) -> jax.Array:
        return -0.5 * jnp.sum(white**2, 1) - self.log_scale - 0.5 * white.shape[1] * jnp.log(2 * jnp.pi)


def factorise(mean: jax.Array, covariance: jax.Array) -> Factorised:
    """Factorise a Gaussian of mean (d,) and covariance (d, d)."""
    scale = jnp.linalg.cholesky(covariance)
    whiten = solve_triangular(scale, jnp.eye(scale.shape[0], dtype=scale.dtype), lower=True)
    return Factorised(mean, scale, whiten, jnp.sum(jnp.log(jnp.diagonal(scale))))


def precision_of(covariance: jax.Array) -> jax.Array:
    """Inverse of a covariance (d, d), scaled to a unit diagonal on the way."""
    whiten = inverse_root(covariance)
    return whiten.T @ whiten


def inverse_root(covariance: jax.Array) -> jax.Array:
    """W, lower triangular (d, d), with W^T W the inverse of a covariance."""
    return triangular_factors(covariance)[1]


def triangular_factors(covariance: jax.Array) -> tuple[jax.Array, jax.Array]:
    """L with L L^T a covariance, and W = L^-1, both lower triangular (d, d)."""
    unit = 1.0 / jnp.sqrt(diagonal(covariance))
    lower = jnp.linalg.cholesky(covariance * unit[:, None] * unit)
    root = solve_triangular(lower, jnp.eye(lower.shape[0], dtype=lower.dtype), lower=True) * unit
    return lower / unit[:, None], root


def diagonal(matrix: jax.Array) -> jax.Array:
    """The diagonal (..., d) of matrices (..., d, d), as a masked sum: a gather of so many entries takes long to compile."""
    return jnp.sum(jnp.where(np.eye(matrix.shape[-1], dtype=bool), matrix, 0.0), -1)
