from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies import rotate
from precision import epsilon
from scipy.spatial.transform import Rotation

from poseppl.motion.geometry.rotations import rotation_about, rotation_from_vector, rotation_zyx, zyx_angles

THRESHOLD = 1e-3  # radians: where Rodrigues' formula changes to its series
ANGLES = np.concatenate([np.geomspace(1e-8, np.pi, 40), THRESHOLD * (1 + np.array([-1e-2, -1e-6, 1e-6, 1e-2]))])
BATCHES = ((), (1,), (4,), (2, 3))
FORMS = {
    "X": lambda angles: rotation_about("X", angles[..., 0]),
    "Y": lambda angles: rotation_about("Y", angles[..., 1]),
    "Z": lambda angles: rotation_about("Z", angles[..., 2]),
    "zyx": rotation_zyx,
    "vector": rotation_from_vector,
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


@pytest.mark.parametrize("seed", range(3))
def test_inverse_and_composition(dtype, seed):
    vector = jnp.asarray(np.random.default_rng(seed).normal(size=(5, 3)))
    tolerance = 20 * epsilon(dtype)  # of two such matrices; found up to 6
    there, back = rotation_from_vector(vector), rotation_from_vector(-vector)
    np.testing.assert_allclose(there @ back, np.broadcast_to(np.eye(3), (5, 3, 3)), atol=tolerance)
    np.testing.assert_allclose(rotation_from_vector(0.25 * vector) @ rotation_from_vector(0.75 * vector), there, atol=tolerance)
    np.testing.assert_allclose(jnp.einsum("nij,nj->ni", there, vector), vector, atol=tolerance)  # the axis stays


def test_against_scipy_and_numpy(dtype):
    rng = np.random.default_rng(0)
    vectors = rng.normal(size=(50, 3))
    expected = Rotation.from_rotvec(vectors.astype(dtype)).as_matrix()
    np.testing.assert_allclose(rotation_from_vector(jnp.asarray(vectors)), expected, atol=20 * epsilon(dtype))
    angles = rng.uniform(-np.pi, np.pi, (50, 3)).astype(dtype)
    expected = Rotation.from_euler("ZYX", angles).as_matrix()
    np.testing.assert_allclose(rotation_zyx(jnp.asarray(angles)), expected, atol=10 * epsilon(dtype))
    for axis in "XYZ":
        np.testing.assert_allclose(rotation_about(axis, 0.7), rotate(axis, 0.7), atol=epsilon(dtype))


def test_angles_round_trip(dtype):
    rng = np.random.default_rng(1)
    angles = rng.uniform(-1, 1, (200, 3)) * np.array([np.pi, np.pi / 2 - 0.01, np.pi]) * 0.999
    np.testing.assert_allclose(zyx_angles(rotation_zyx(jnp.asarray(angles))), angles, atol=300 * epsilon(dtype))


def rodrigues(vector):
    """The textbook's formula, good away from zero only."""
    angle = jnp.sqrt(jnp.sum(vector**2))
    x, y, z = vector / angle
    cross = jnp.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return jnp.eye(3) + jnp.sin(angle) * cross + 2 * jnp.sin(angle / 2) ** 2 * cross @ cross


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.6, -0.48, 0.64)], ids=["axis", "oblique"])
def test_both_branches_against_the_series_and_the_formula(dtype, direction):
    """Value and derivative at every scale, by the matrix exponential's series below 0.1 radian and the formula above."""
    direction = np.array(direction)
    jacobian = jax.jit(jax.jacfwd(rotation_from_vector))
    backward = jax.jit(jax.jacrev(rotation_from_vector))
    formula = jax.jit(jax.jacfwd(rodrigues))
    for angle in ANGLES:
        vector = jnp.asarray(angle * direction)
        if angle < 0.1:
            value, derivative = exponential_series(np.asarray(vector, np.float64))
        else:
            value, derivative = rodrigues(vector), formula(vector)
        np.testing.assert_allclose(rotation_from_vector(vector), value, atol=4 * epsilon(dtype), err_msg=str(angle))
        for found in (jacobian(vector), backward(vector)):
            np.testing.assert_allclose(found, derivative, atol=40 * epsilon(dtype), err_msg=str(angle))


def exponential_series(vector, terms=12):
    """exp([v]x) and its derivative in float64, term by term."""

    def cross(v):
        return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])

    generators = [cross(row) for row in np.eye(3)]
    power, slopes = np.eye(3), [np.zeros((3, 3))] * 3
    value, derivative = np.eye(3), np.zeros((3, 3, 3))
    for n in range(1, terms):
        slopes = [(slope @ cross(vector) + power @ g) / n for slope, g in zip(slopes, generators, strict=True)]
        power = power @ cross(vector) / n
        value = value + power
        derivative += np.stack(slopes, -1)
    return value, derivative


def test_gradient_at_zero_is_the_generator(dtype):
    jacobian = jax.jit(jax.jacrev(rotation_from_vector))(jnp.zeros(3))
    expected = np.zeros((3, 3, 3))
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        expected[k, j, i], expected[j, k, i] = 1, -1
    np.testing.assert_array_equal(jacobian, expected)
