r"""Block-tridiagonal precision matrices: the curvature of a whole trajectory of a Markov model, and its square root.

A trajectory x = (x_0, ..., x_(T-1)) of a state-space model has a precision P whose only blocks beside the diagonal D_t are
B_t = P_(t+1, t) and their transposes. Its Cholesky factor L has blocks L_t on the diagonal and C_t below it,

    C_t = B_t L_t^(-T),        L_(t+1) L_(t+1)^T = D_(t+1) - C_t C_t^T,        log det P = 2 sum_t log det L_t

(Rue and Held 2005, Gaussian Markov Random Fields, section 2.4.1, doi:10.1201/9780203492024): O(T d^3) once. With W_t = L_t^(-1)
and K_t = C_t W_t, both kept, solving is one product for all frames at once and one recurrence over them, O(T d^2):

    x = L^(-T) z :   x_t = W_t^T z_t - K_t^T x_(t+1),
    y = L^(-1) b :   e_(t+1) = b_(t+1) - K_t e_t,     y_t = W_t e_t,

and either is the other's transpose. For z standard normal, L^(-T) z is a draw from N(0, P^-1).

Blocks are scaled to a unit diagonal before they are factorised: millimetres and radians side by side cost float32 its digits.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.gaussians.gaussian import lower_inverse


class BlockTridiagonal(NamedTuple):
    """A symmetric matrix of T x T blocks.

    Attributes:
        diagonal: D_t, symmetric (T, d, d).
        below: B_t, the blocks of row t + 1 and column t (T - 1, d, d).
    """

    diagonal: Array
    below: Array


class BlockCholesky(NamedTuple):
    """The Cholesky factor L of a positive definite block-tridiagonal matrix, ready for solving.

    Attributes:
        inverses: W_t, inverses of the diagonal blocks of L, lower triangular (T, d, d).
        gains: K_t, the blocks below the diagonal times W_t (T - 1, d, d).
    """

    inverses: Array
    gains: Array

    @property
    def log_det(self) -> Array:
        """The log-determinant of P, a scalar."""
        return -2.0 * jnp.sum(jnp.log(jnp.diagonal(self.inverses, axis1=1, axis2=2)))


class MarginalCovariances(NamedTuple):
    """Covariances of a Gaussian trajectory: ``own`` (T, d, d), and ``next`` = Cov(x_(t+1), x_t) (T - 1, d, d)."""

    own: Array
    next: Array


def multiply(matrix: BlockTridiagonal, x: Array) -> Array:
    """P x for x (T, d)."""
    product = jnp.einsum("tij,tj->ti", matrix.diagonal, x)
    product = product.at[1:].add(jnp.einsum("tij,tj->ti", matrix.below, x[:-1]))
    return product.at[:-1].add(jnp.einsum("tji,tj->ti", matrix.below, x[1:]))


def to_dense(matrix: BlockTridiagonal) -> Array:
    """The whole matrix (T d, T d)."""
    num_blocks, dimension = matrix.diagonal.shape[:2]
    frame = jnp.arange(num_blocks)
    whole = jnp.zeros((num_blocks, dimension, num_blocks, dimension), matrix.diagonal.dtype)
    whole = whole.at[frame, :, frame].set(matrix.diagonal)
    whole = whole.at[frame[1:], :, frame[:-1]].set(matrix.below)
    whole = whole.at[frame[:-1], :, frame[1:]].set(jnp.swapaxes(matrix.below, 1, 2))
    return whole.reshape(num_blocks * dimension, num_blocks * dimension)


def block_cholesky(matrix: BlockTridiagonal, *, ridge: Any = 0.0) -> BlockCholesky:
    """Factorise P = L L^T.

    Args:
        matrix: P, positive definite; where it is not, NaN comes out.
        ridge: Added to the diagonal of the matrix scaled to a unit diagonal.
    """
    unit = 1.0 / jnp.sqrt(jnp.diagonal(matrix.diagonal, axis1=1, axis2=2))
    eye = jnp.eye(unit.shape[1], dtype=unit.dtype)
    diagonal = matrix.diagonal * unit[:, :, None] * unit[:, None, :] + ridge * eye
    below = matrix.below * unit[1:, :, None] * unit[:-1, None, :]

    def invert(block: Array) -> Array:
        return lower_inverse(jnp.linalg.cholesky(block))

    def advance(inverse: Array, blocks: tuple[Array, Array]) -> tuple[Array, tuple[Array, Array]]:
        block, beside = blocks
        lower = beside @ inverse.T
        following = invert(block - lower @ lower.T)
        return following, (following, lower @ inverse)

    first = invert(diagonal[0])
    _, (later, gains) = jax.lax.scan(advance, first, (diagonal[1:], below))
    inverses = jnp.concatenate([first[None], later]) * unit[:, None, :]
    return BlockCholesky(inverses, gains / unit[1:, :, None] * unit[:-1, None, :])


def solve_upper(factor: BlockCholesky, z: Array) -> Array:
    """L^(-T) z for z (T, d)."""
    scaled = jnp.einsum("tji,tj->ti", factor.inverses, z)

    def back(x: Array, row: tuple[Array, Array]) -> tuple[Array, Array]:
        x = row[0] - x @ row[1]
        return x, x

    _, earlier = jax.lax.scan(back, scaled[-1], (scaled[:-1], factor.gains), reverse=True)
    return jnp.concatenate([earlier, scaled[-1:]])


def marginal_covariances(factor: BlockCholesky) -> MarginalCovariances:
    """Covariances of single frames and of neighbours: S_t = W_t^T W_t + K_t^T S_(t+1) K_t is that of a frame."""
    inverses, gains = factor
    conditional = jnp.einsum("tji,tjk->tik", inverses, inverses)

    def back(following: Array, row: tuple[Array, Array]) -> tuple[Array, tuple[Array, Array]]:
        own, gain = row
        covariance = own + gain.T @ following @ gain
        return covariance, (covariance, -following @ gain)

    _, (earlier, beside) = jax.lax.scan(back, conditional[-1], (conditional[:-1], gains), reverse=True)
    return MarginalCovariances(jnp.concatenate([earlier, conditional[-1:]]), beside)


def solve_lower(factor: BlockCholesky, b: Array) -> Array:
    """L^(-1) b for b (T, d)."""

    def forward(e: Array, row: tuple[Array, Array]) -> tuple[Array, Array]:
        e = row[0] - row[1] @ e
        return e, e

    _, later = jax.lax.scan(forward, b[0], (b[1:], factor.gains))
    return jnp.einsum("tij,tj->ti", factor.inverses, jnp.concatenate([b[:1], later]))


def solve(factor: BlockCholesky, b: Array) -> Array:
    """P^(-1) b for b (T, d)."""
    return solve_upper(factor, solve_lower(factor, b))


@jax.custom_vjp
def solve_with_log_det(matrix: BlockTridiagonal, b: Array) -> tuple[Array, Array]:
    """P^(-1) b (T, d) and log det P, a scalar, of a positive definite P; differentiated without going back through the factor.

    Let x = P^(-1) b, with the cotangents v of x and l of the log-determinant. The cotangent of b is w = P^(-1) v. That of P is
    l P^(-1) - (w x^T + x w^T) / 2, of which only the blocks of P are computed (:func:`marginal_covariances`).
    """
    factor = block_cholesky(matrix)
    return solve(factor, b), factor.log_det


def _solve_forward(matrix: BlockTridiagonal, b: Array) -> tuple[tuple[Array, Array], tuple[BlockCholesky, Array]]:
    factor = block_cholesky(matrix)
    x = solve(factor, b)
    return (x, factor.log_det), (factor, x)


def _solve_backward(kept: tuple[BlockCholesky, Array], cotangents: tuple[Array, Array]) -> tuple[BlockTridiagonal, Array]:
    (factor, x), (v, of_log_det) = kept, cotangents
    w, inverse = solve(factor, v), marginal_covariances(factor)

    def outer(a: Array, b: Array) -> Array:
        return jnp.einsum("ti,tj->tij", a, b)

    diagonal = of_log_det * inverse.own - (outer(w, x) + outer(x, w)) / 2
    below = 2 * of_log_det * inverse.next - outer(w[1:], x[:-1]) - outer(x[1:], w[:-1])
    return BlockTridiagonal(diagonal, below), w


solve_with_log_det.defvjp(_solve_forward, _solve_backward)
