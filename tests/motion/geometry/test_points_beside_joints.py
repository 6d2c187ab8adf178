"""Points of markers beside their joints: their derivative in closed form is that of automatic differentiation."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array
from poseppl_models.bodies.choo_fleet import full_body

from poseppl.motion.geometry import join_cameras, look_at
from poseppl.motion.likelihoods import DetectedPoints
from poseppl.program.closed_forms import WhitenedJacobian

BODY = full_body()
CAMERAS = join_cameras(
    [look_at(centre, (0.0, 0.0, 900.0), 1500.0) for centre in ((0.0, -4000.0, 1000.0), (3000.0, 2000.0, 500.0))]
)
SHAPE = (2, len(BODY.tree.marker_names), 2)


def points_of(num_lengths: int, erring: bool, rng: np.random.Generator) -> tuple[Any, Array]:
    """The distribution as a function of its state, and a state."""
    tree, floats = BODY.tree, lambda value: jnp.asarray(value, float)
    parts = [tree.dimension, SHAPE[1] * 3, int(np.prod(SHAPE)), num_lengths, 6 * len(CAMERAS.centre) * erring]
    per_length = jax.tree.map(lambda leaf: floats(rng.normal(size=(num_lengths, *leaf.shape))), tree)
    per_length = per_length.with_offsets(per_length.offsets.at[:, 0].set(0.0), per_length.marker_offsets)  # a root has none
    lasting, scale = floats(rng.uniform(1, 3, SHAPE[:2])), floats(rng.uniform(1, 3, SHAPE[:2]))

    def distribution(state: Array) -> DetectedPoints:
        pose, shift, error, lengths, cameras = jnp.split(state, np.cumsum(parts)[:-1])
        return DetectedPoints(
            tree,
            CAMERAS,
            pose,
            shift.reshape(-1, 3),
            error.reshape(SHAPE),
            lasting=lasting,
            scale=scale,
            lengths=lengths,
            per_length=per_length if num_lengths else None,
            camera_errors=cameras,
        )

    sizes = np.repeat([0.1, 20.0, 1.0, 10.0, 0.01], parts)
    sizes[-parts[-1] or len(sizes) :] = np.tile([0.01] * 3 + [10.0] * 3, parts[-1] // 6)
    return distribution, floats(np.pad(BODY.rest, (0, sum(parts[1:]))) + sizes * rng.normal(size=sum(parts)))


@pytest.mark.parametrize(
    "num_lengths, erring",
    [(3, False), *(pytest.param(*case, marks=pytest.mark.full) for case in [(0, False), (0, True), (3, True)])],
)
def test_the_derivative_is_that_of_automatic_differentiation(num_lengths: int, erring: bool) -> None:
    """Column by column, for a radian moves a point a thousand times as far as a millimetre; what is not seen is 0."""
    rng = np.random.default_rng(0)
    distribution, state = points_of(num_lengths, erring, rng)
    seen = rng.random(SHAPE) < 0.7
    assert isinstance(distribution(state), WhitenedJacobian)
    np.testing.assert_array_equal(distribution(state).state, state)
    expected = np.asarray(jax.jit(jax.jacrev(lambda x: jnp.ravel(distribution(x).loc / distribution(x).scale)))(state))
    for mask, kept in ((None, np.ones(SHAPE, bool)), (jnp.asarray(seen), seen)):
        found = np.asarray(jax.jit(lambda x, mask=mask: distribution(x).whitened_jacobian(mask))(state))
        wanted = np.where(kept.reshape(-1, 1), expected, 0.0)
        largest = np.abs(expected).max(0)
        assert found.shape == expected.shape and np.all(largest > 0)
        np.testing.assert_allclose(found / largest, wanted / largest, atol=2e-4)
    states = jnp.stack([state, state + 0.1 * rng.normal(size=state.shape)])
    each = jax.jit(jax.vmap(lambda x: distribution(x).whitened_jacobian(None)))(states)
    np.testing.assert_allclose(each[0] / largest, expected / largest, atol=2e-4)
    assert not np.allclose(each[1] / largest, expected / largest, atol=2e-4)
