"""One Gaussian: its moments, its factors, its precision."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.scipy.linalg import solve_triangular

_ALONE = 32
"""Rows of a triangular matrix up to which OpenBLAS inverts it with one thread."""


class Gaussian(NamedTuple):
    """A mean (..., d) and a covariance (..., d, d)."""

    mean: Array
    covariance: Array


class RootGaussian(NamedTuple):
    """A mean (..., d) and a lower triangular scale (..., d, d), of covariance scale scale^T.

    In float32 a covariance has no room for a variance of 1 beside one of 10^8; its root has.
    """

    mean: Array
    scale: Array

    @property
    def covariance(self) -> Array:
        """(..., d, d)."""
        return self.scale @ jnp.swapaxes(self.scale, -1, -2)


class Linear(NamedTuple):
    """A linear conditional: mean (k,) of y at the mean of x, jacobian (k, d) and noise covariance (k, k)."""

    mean: Array
    jacobian: Array
    noise: Array


@jax.custom_jvp
def triangular(root: Array) -> Array:
    """L, lower triangular (d, d) of a diagonal that is not negative, with L L^T = B B^T for B (d, n), n at least d."""
    lower: Array = jnp.linalg.qr(root.T, mode="r").T
    return lower * jnp.where(diagonal(lower) < 0, -1.0, 1.0)


@triangular.defjvp
def _triangular_derivative(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    """That of a Cholesky factor; coordinates without variance stay so, where QR's own derivative is not finite."""
    (root,), (change,) = primals, tangents
    lower = triangular(root)
    known = diagonal(lower) == 0
    whiten = solve_triangular(lower + jnp.diag(known.astype(lower.dtype)), jnp.eye(len(lower), dtype=lower.dtype), lower=True)
    moved = whiten @ (root @ change.T + change @ root.T) @ whiten.T
    moved = jnp.where(known[:, None] | known, 0.0, moved)
    return lower, lower @ (jnp.tril(moved) - 0.5 * jnp.diag(diagonal(moved)))


def semidefinite_root(covariance: Array) -> Array:
    """L, lower triangular (d, d), with L L^T a covariance, of which some variances or eigenvalues may be 0."""
    variances, size = diagonal(covariance), covariance.shape[0]
    known = variances == 0
    deviations = jnp.sqrt(jnp.where(known, 1.0, variances))
    unit = covariance / deviations[:, None] / deviations + jnp.diag(known.astype(covariance.dtype))
    # rounding makes eigenvalues of 0 negative
    singular = ~jnp.all(jnp.isfinite(jax.lax.stop_gradient(jnp.linalg.cholesky(unit))))
    lifted = jnp.where(singular, 4 * size * np.finfo(covariance.dtype).eps, 0.0)
    lower = jnp.linalg.cholesky(unit + lifted * jnp.eye(size, dtype=covariance.dtype))
    root: Array = lower * jnp.where(known, 0.0, deviations)[:, None]
    return root


def lower_root(x: Gaussian | RootGaussian) -> Array:
    """L, lower triangular (d, d), with L L^T the covariance."""
    return x.scale if isinstance(x, RootGaussian) else jnp.linalg.cholesky(x.covariance)


class Factorised(NamedTuple):
    """A Gaussian with its factors, made once: mean (d,), scale = Cholesky factor (d, d), its inverse, and log |scale|."""

    mean: Array
    scale: Array
    whiten: Array
    log_scale: Array

    def log_density(self, xs: Array) -> Array:
        """Log-densities (N,) of states (N, d)."""
        return self._of_white((xs - self.mean) @ self.whiten.T)

    def draw(self, rng_key: Array, num: int) -> tuple[Array, Array]:
        """Draw states (N, d), with their log-densities (N,)."""
        white = jax.random.normal(rng_key, (num, self.mean.shape[-1]), self.mean.dtype)
        return self.mean + white @ self.scale.T, self._of_white(white)

    def _of_white(self, white: Array) -> Array:
        return -0.5 * jnp.sum(white**2, 1) - self.log_scale - 0.5 * white.shape[1] * jnp.log(2 * jnp.pi)


def factorise(mean: Array, covariance: Array) -> Factorised:
    """Factorise a Gaussian of mean (d,) and covariance (d, d)."""
    scale = jnp.linalg.cholesky(covariance)
    whiten = lower_inverse(scale)
    return Factorised(mean, scale, whiten, jnp.sum(jnp.log(jnp.diagonal(scale))))


def precision_of(covariance: Array) -> Array:
    """Inverse of a covariance (d, d), scaled to a unit diagonal on the way."""
    whiten = inverse_root(covariance)
    return whiten.T @ whiten


def inverse_root(covariance: Array) -> Array:
    """W, lower triangular (d, d), with W^T W the inverse of a covariance."""
    return triangular_factors(covariance)[1]


def triangular_factors(covariance: Array) -> tuple[Array, Array]:
    """L with L L^T a covariance, and W = L^-1, both lower triangular (d, d)."""
    unit = 1.0 / jnp.sqrt(diagonal(covariance))
    lower = jnp.linalg.cholesky(covariance * unit[:, None] * unit)
    root = lower_inverse(lower) * unit
    return lower / unit[:, None], root


def lower_inverse(lower: Array) -> Array:
    """Inverse of a lower triangular matrix (k, k).

    Large ones by halves, [[A, 0], [B, C]] from the inverses of A and C: products are XLA's own. OpenBLAS would wake a second
    thread for them. Its threads spin while they wait for each other: on a busy machine, a hundred times as long as the solution
    takes.
    """
    size = lower.shape[0]
    if size <= _ALONE:
        return solve_triangular(lower, jnp.eye(size, dtype=lower.dtype), lower=True)
    half = size // 2
    first, last = lower_inverse(lower[:half, :half]), lower_inverse(lower[half:, half:])
    beside = -last @ lower[half:, :half] @ first
    return jnp.block([[first, jnp.zeros((half, size - half), lower.dtype)], [beside, last]])


def diagonal(matrix: Array) -> Array:
    """The diagonal (..., d) of matrices (..., d, d), as a masked sum: a gather of so many entries takes long to compile."""
    return jnp.sum(jnp.where(np.eye(matrix.shape[-1], dtype=bool), matrix, 0.0), -1)
