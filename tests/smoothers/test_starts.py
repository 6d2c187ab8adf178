"""Starts of smoothers that run chains: trajectories of a history, also when it is thinned first."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.toys.linear_gaussian import linear_gaussian

from poseppl.smoothers import History
from poseppl.smoothers.backward_pass import initial_trajectories


def test_many_particles_are_thinned_by_their_weights_once():
    """1000 particles at two places, a tenth of the weight at the second: of the last frame's draws a tenth is there."""
    model, draws = linear_gaussian(1).compile(), 4000
    places = jnp.broadcast_to(jnp.where(jnp.arange(1000) < 500, 0.0, 0.5), (2, 1000))
    log_weights = jnp.log(jnp.where(places > 0, 0.1, 0.9) / 500)
    history = History(places[..., None], log_weights, jnp.zeros((2, 1000), jnp.int32), jnp.zeros(2, bool))
    found = jax.jit(lambda key: initial_trajectories(model, key, history, None, draws))(jax.random.key(0))
    assert found.shape == (draws, 2, 1)
    # systematic thinning to 512 keeps the share to a slot
    assert abs(np.mean(np.asarray(found[:, -1]) > 0) - 0.1) < 5 * np.sqrt(0.09 / draws) + 1 / 512
