"""The correlation function of Gaspari and Cohn: its values, its smoothness, and that its matrices are covariances."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.gaussians.localisation import gaspari_cohn


def test_it_is_a_self_convolution_of_triangles():
    """The definition: two triangles of half-width c in three dimensions, convolved; here by its table of values."""
    known = {0.0: 1.0, 0.5: 263 / 384, 1.0: 5 / 24, 1.5: 0.016493055555, 2.0: 0.0, 3.0: 0.0}
    with jax.enable_x64(True):
        found = gaspari_cohn(jnp.array(list(known)))
    np.testing.assert_allclose(found, list(known.values()), atol=1e-9)


def test_its_pieces_join_with_their_derivatives():
    with jax.enable_x64(True):
        slope = jax.vmap(jax.grad(gaspari_cohn))
        for joint, value in ((1.0, None), (2.0, 0.0)):
            below, above = slope(jnp.array([joint - 1e-7, joint + 1e-7]))
            np.testing.assert_allclose(below, above, atol=1e-5)
            assert value is None or abs(above - value) < 1e-12


@pytest.mark.full
def test_its_matrices_are_positive_semi_definite():
    places = np.random.default_rng(0).uniform(0, 10, (200, 3))
    distances = np.linalg.norm(places[:, None] - places, axis=-1)
    with jax.enable_x64(True):
        values = np.linalg.eigvalsh(gaspari_cohn(jnp.asarray(distances / 3)))
    assert values.min() > -1e-12
