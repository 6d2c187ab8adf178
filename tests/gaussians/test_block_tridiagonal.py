"""Block-tridiagonal matrices against dense linear algebra."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from precision import DTYPES, epsilon, precision

from poseppl.gaussians.block_tridiagonal import (
    BlockTridiagonal,
    block_cholesky,
    marginal_covariances,
    multiply,
    solve,
    solve_lower,
    solve_upper,
    solve_with_log_det,
    to_dense,
)


def random_matrix(num_frames, dimension, seed=0, scales=None):
    """A positive definite block-tridiagonal matrix, as blocks and dense (T d, T d): L L^T of a random block factor."""
    rng = np.random.default_rng(seed)
    size = num_frames * dimension
    frame = np.arange(size) // dimension
    kept = (frame[:, None] - frame <= 1) & np.tri(size, dtype=bool)
    lower = np.where(kept, rng.normal(size=(size, size)), 0.0)
    np.fill_diagonal(lower, 2.0 + rng.random(size))
    dense = lower @ lower.T
    if scales is not None:
        scale = np.tile(scales, num_frames)
        dense = dense * scale[:, None] * scale
    blocks = dense.reshape(num_frames, dimension, num_frames, dimension).transpose(0, 2, 1, 3)
    index = np.arange(num_frames)
    return BlockTridiagonal(jnp.asarray(blocks[index, index]), jnp.asarray(blocks[index[1:], index[:-1]])), dense


@jax.jit
def answers(matrix, b):
    factor = block_cholesky(matrix)
    upper = solve_upper(factor, b)
    back = solve_lower(factor, multiply(matrix, upper))  # L^T L^(-T) b
    return (
        multiply(matrix, b),
        solve(factor, b),
        solve_lower(factor, b),
        upper,
        factor.log_det,
        back,
        marginal_covariances(factor).own,
    )


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("shape", [(1, 3), (2, 1), (6, 3)])
def test_agrees_with_dense_linear_algebra(shape, dtype):
    with precision(dtype):
        matrix, dense = random_matrix(*shape)
        b = np.random.default_rng(1).normal(size=shape)
        lower = np.linalg.cholesky(dense)
        expected = (
            dense @ b.ravel(),
            np.linalg.solve(dense, b.ravel()),
            np.linalg.solve(lower, b.ravel()),
            np.linalg.solve(lower.T, b.ravel()),
            np.linalg.slogdet(dense)[1],
            b.ravel(),
            np.einsum("titj->tij", np.linalg.inv(dense).reshape(*shape, *shape)).ravel(),
        )
        # a bound on roundings, far wider than what is found; a wrong entry would be off by its own size
        tolerance = 1e3 * epsilon(dtype) * np.linalg.cond(dense) ** 0.5
        for found, answer in zip(answers(matrix, jnp.asarray(b)), expected, strict=True):
            assert found.dtype == dtype
            np.testing.assert_allclose(found.ravel(), answer, rtol=tolerance, atol=tolerance * np.abs(answer).max())


@pytest.mark.full
@pytest.mark.parametrize("shape", [(1, 3), (2, 1), (6, 3)])
def test_dense_form_holds_every_block(shape):
    matrix, dense = random_matrix(*shape)
    np.testing.assert_allclose(to_dense(matrix), dense, rtol=1e-6)


@pytest.mark.full
def test_scales_far_apart_cost_float32_no_digits():
    """As millimetres beside radians do: the error is that of the matrix with a unit diagonal."""
    matrix, dense = random_matrix(5, 3, scales=[1e-4, 1.0, 1e3])
    b = np.random.default_rng(2).normal(size=(5, 3)) * [1e-4, 1.0, 1e3]
    found = answers(matrix, jnp.asarray(b))[1]
    np.testing.assert_allclose(found.ravel(), np.linalg.solve(dense, b.ravel()), rtol=1e-3)


def test_one_solve_is_the_transpose_of_the_other():
    matrix, _ = random_matrix(4, 2)
    z, b = np.random.default_rng(3).normal(size=(2, 4, 2)).astype(np.float32)

    @jax.jit
    def both(z, b):
        factor = block_cholesky(matrix)
        return jax.linear_transpose(lambda z: solve_upper(factor, z), z)(b)[0], solve_lower(factor, b)

    np.testing.assert_allclose(*both(z, b), rtol=1e-5)


@pytest.mark.full
def test_a_ridge_makes_a_singular_matrix_definite():
    matrix = BlockTridiagonal(jnp.ones((3, 2, 2)), jnp.zeros((2, 2, 2)))
    factorise = jax.jit(block_cholesky)
    assert np.isfinite(factorise(matrix, ridge=1e-4).inverses).all()
    assert not np.isfinite(factorise(matrix, ridge=0.0).inverses).all()


@pytest.mark.full
@pytest.mark.parametrize("shape", [(1, 3), (2, 1), (6, 3)])
def test_the_solution_and_log_determinant_have_the_dense_ones_gradient(shape):
    with precision(jnp.float64):
        matrix, dense = random_matrix(*shape)
        b, weights = (jnp.asarray(np.random.default_rng(seed).normal(size=shape)) for seed in (1, 2))

        def by_blocks(matrix, b):
            x, log_det = solve_with_log_det(matrix, b)
            return jnp.sum(weights * jnp.sin(x)) + log_det**2

        def densely(matrix, b):
            whole = to_dense(matrix)
            whole = jnp.tril(whole) + jnp.tril(whole, -1).T  # of blocks on the diagonal the lower half counts
            x = jnp.linalg.solve(whole, b.ravel()).reshape(b.shape)
            return jnp.sum(weights * jnp.sin(x)) + jnp.linalg.slogdet(whole)[1] ** 2

        (value, (blocks, of_b)), (other, (expected, expected_of_b)) = (
            jax.value_and_grad(of, (0, 1))(matrix, b) for of in (by_blocks, densely)
        )
        np.testing.assert_allclose(value, other, rtol=1e-10)
        np.testing.assert_allclose(of_b, expected_of_b, rtol=1e-8, atol=1e-10)
        np.testing.assert_allclose(blocks.below, expected.below, rtol=1e-8, atol=1e-10)
        lower = np.tril(blocks.diagonal) + np.tril(np.swapaxes(blocks.diagonal, 1, 2), -1)
        np.testing.assert_allclose(lower, expected.diagonal, rtol=1e-8, atol=1e-10)
