from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies import rotate
from precision import epsilon
from scipy.spatial.transform import Rotation

from poseppl.motion.geometry.rotations import rotation_about

BATCHES = ((), (1,), (4,), (2, 3))
FORMS = {
    "X": lambda angles: rotation_about("X", angles[..., 0]),
    "Y": lambda angles: rotation_about("Y", angles[..., 1]),
    "Z": lambda angles: rotation_about("Z", angles[..., 2]),
}


@pytest.mark.parametrize("batch", BATCHES, ids=str)
@pytest.mark.parametrize("form", FORMS)
def test_is_a_rotation(dtype, form, batch):
    compiled = jax.jit(FORMS[form])
    for seed in range(5):
        matrix = compiled(jnp.asarray(np.random.default_rng(seed).uniform(-np.pi, np.pi, (*batch, 3))))
        assert matrix.shape == (*batch, 3, 3) and matrix.dtype == dtype
        turn = np.asarray(matrix, np.float64)
        tolerance = 20 * epsilon(dtype)  # some ten roundings lead to an entry, of size up to 2; found up to 7
        np.testing.assert_allclose(turn @ np.swapaxes(turn, -1, -2), np.broadcast_to(np.eye(3), turn.shape), atol=tolerance)
        np.testing.assert_allclose(np.linalg.det(turn), 1.0, atol=tolerance)


def test_against_scipy_and_numpy(dtype):
    rng = np.random.default_rng(0)
    angles = rng.uniform(-np.pi, np.pi, (50, 3)).astype(dtype)
    expected = Rotation.from_euler("ZYX", angles).as_matrix()
    about_z, about_y, about_x = (rotation_about(axis, jnp.asarray(angles[:, i])) for i, axis in enumerate("ZYX"))
    np.testing.assert_allclose(about_z @ about_y @ about_x, expected, atol=10 * epsilon(dtype))
    for axis in "XYZ":
        np.testing.assert_allclose(rotation_about(axis, 0.7), rotate(axis, 0.7), atol=epsilon(dtype))
