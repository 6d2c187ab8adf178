"""Places of a body's parts: by the book on a body with every kind of joint, their gradients, and what cannot be a part."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies import JOINTS, mixed_tree, plain_kinematics, states
from precision import epsilon, precision

from poseppl.motion.geometry import Marker
from poseppl.motion.geometry.flesh import Cone, flesh_of, part_frames, parts_of, sphere

pytestmark = pytest.mark.full

SIZE = 3000.0  # mm: tolerances in mm are this times the rounding
PARTS = (
    Cone("trunk", "root", 500.0, (150.0, 120.0), (1.0, 0.7)),
    Cone("limb", "side", 400.0, (60.0, 50.0), origin=(10.0, 20.0, -5.0), axis=(0, 0, -1)),
    Cone("slant", "wheel", -300.0, (50.0, 40.0), axis=(1, 2, 3), across=(0, 0, 1)),
    Cone("turned", "tip", 130.0, (30.0, 20.0), axis=(0, 1, 0), across=(1, 1, 0)),
    sphere("skull", "fixed", 110.0, (0.0, 15.0, 90.0)),
)


def points_of(part):
    """A part's base, its tip, and a place on its own x, in its joint's frame."""
    z = np.array(part.axis, float) / np.linalg.norm(part.axis)
    x = np.array(part.across, float)
    x -= z * (z @ x)
    return np.array(part.origin) + np.array([0 * z, z * part.length, 100.0 * x / np.linalg.norm(x)])


def test_parts_are_where_markers_of_the_same_offsets_are(dtype):
    tree, body = mixed_tree(), flesh_of(mixed_tree(), PARTS)
    markers = [Marker(f"{part.name}{i}", part.joint, tuple(point)) for part in PARTS for i, point in enumerate(points_of(part))]
    for state in states(tree, 5):
        found = part_frames(tree, body, jnp.asarray(state, dtype))
        expected = plain_kinematics(JOINTS, markers, state).reshape(-1, 3, 3)
        np.testing.assert_allclose(found.base, expected[:, 0], atol=20 * SIZE * epsilon(dtype))
        np.testing.assert_allclose(found.tip, expected[:, 1], atol=20 * SIZE * epsilon(dtype))
        np.testing.assert_allclose(found.base + 100 * found.axes[:, :, 0], expected[:, 2], atol=20 * SIZE * epsilon(dtype))
        turns = np.asarray(found.axes, np.float64)
        np.testing.assert_allclose(turns @ turns.transpose(0, 2, 1), np.eye(3)[None].repeat(5, 0), atol=20 * epsilon(dtype))
        np.testing.assert_allclose(np.linalg.det(turns), 1.0, rtol=20 * epsilon(dtype))


def test_gradients_against_finite_differences():
    """Exact up to central differences: steps of 1e-5 leave some 1e-9 of the gradient in float64."""
    with precision(np.float64):
        tree, body = mixed_tree(), flesh_of(mixed_tree(), PARTS)
        bodies = jax.tree.map(lambda leaf: leaf[..., None], (tree, body))
        weights = jax.tree.map(
            lambda leaf: jnp.cos(jnp.arange(leaf.size).reshape(leaf.shape)), parts_of(*bodies, jnp.ones((tree.dimension, 1)))
        )

        @jax.jit
        def scores(x):  # (d, N), the batch last
            parts = parts_of(*bodies, x)
            return sum(jnp.sum(w * leaf, tuple(range(leaf.ndim - 1))) for w, leaf in zip(weights, parts, strict=True))

        for state in states(tree, 3, seed=1):
            x = jnp.asarray(state)[:, None]
            found = jax.grad(lambda x: scores(x)[0])(x)[:, 0]
            steps = 1e-5 * jnp.eye(tree.dimension)
            expected = (scores(x + steps) - scores(x - steps)) / 2e-5
            np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-8 * SIZE)


def test_a_batch_is_one_at_a_time(dtype):
    tree, body = mixed_tree(), flesh_of(mixed_tree(), PARTS)
    many = jnp.asarray(states(tree, 11, seed=2), dtype)
    together = jax.vmap(lambda x: part_frames(tree, body, x))(many)
    alone = jax.jit(lambda x: part_frames(tree, body, x))
    for i, state in enumerate(many):
        for found, expected in zip(together, alone(state), strict=True):
            np.testing.assert_allclose(found[i], expected, atol=20 * SIZE * epsilon(dtype))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"joint": "hand"}, "expected one of"),
        ({"name": "limb"}, "two parts are named 'limb'"),
        ({"length": 0.0}, "expected sizes"),
        ({"radii": (0.0, 0.0)}, "expected sizes"),
        ({"radii": (50.0, -1.0)}, "expected sizes"),
        ({"scale": (1.0, 0.0)}, "expected sizes"),
        ({"across": (0.0, 0.0, 2.0)}, "x along its axis"),
    ],
)
def test_what_is_no_part(change, words):
    with pytest.raises(ValueError, match=words):
        flesh_of(mixed_tree(), [PARTS[1], PARTS[0]._replace(**change)])
    with pytest.raises(ValueError, match="at least one part"):
        flesh_of(mixed_tree(), [])
