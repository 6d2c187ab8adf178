"""The inverse of a triangular matrix, whole or a few columns at a time."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.gaussians.gaussian import lower_inverse

pytestmark = pytest.mark.full


@pytest.mark.parametrize("size", [1, 32, 33, 70])
def test_triangular_matrices_are_inverted(size):
    draws = np.random.default_rng(size).standard_normal((4 * size, size))
    lower = np.linalg.cholesky(draws.T @ draws)
    with jax.enable_x64(True):
        inverse = np.asarray(lower_inverse(jnp.asarray(lower)))
        stacked = jax.vmap(lower_inverse)(jnp.stack([jnp.asarray(lower), 2 * jnp.asarray(lower)]))
    np.testing.assert_allclose(inverse @ lower, np.eye(size), atol=1e-12)
    np.testing.assert_allclose(stacked[1], inverse / 2, rtol=1e-12)
