"""Limbs that are turned by half a turn and bent backwards come back to the pose that they were made of."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from limbs_backwards import backwards
from precision import precision

from poseppl.motion.geometry import marker_positions
from poseppl.motion.geometry.kinematic_jumps import bent_as_at_rest
from poseppl.motion.recordings.subjects import walking_subject

pytestmark = pytest.mark.full


def test_a_walk_is_itself_again() -> None:
    subject = walking_subject(frames="0:40", rate=30.0)
    body, rng = subject.body, np.random.default_rng(0)
    states = np.asarray(subject.states, np.float64)
    draws = np.stack([backwards(body, states, rng.random((len(states), 4)) < 0.5) for _ in range(3)], 1)
    assert np.abs(draws - states[:, None]).max() > 2.0
    with precision(np.float64):
        tree = body.tree.with_offsets(
            *(jnp.asarray(np.asarray(a), float) for a in (body.tree.offsets, body.tree.marker_offsets))
        )
        bent = bent_as_at_rest(tree, jnp.asarray(body.rest, float), jnp.asarray(draws), jnp.zeros(draws.shape[:2]))
        places = jax.vmap(jax.vmap(lambda x: marker_positions(tree, x)))
        assert jnp.abs(places(bent) - places(jnp.asarray(draws))).max() < 1e-6
        assert jnp.abs(bent - states[:, None]).max() < 1e-6
