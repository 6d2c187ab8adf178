"""Pieces of filters that carry modes: their prediction, and draws that keep to bounds."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

from poseppl.filters.published.mode_mixture import _folded, predicted_modes
from poseppl.gaussians.mixture import GaussianMixture
from poseppl.kernels.constraints import constraints
from poseppl.program import StateSpaceModel


def test_states_beyond_a_bound_are_mirrored_at_it():
    bounds = constraints(4, lower=[0.0, -np.inf, 0.0, -np.inf], upper=[np.inf, 2.0, 2.0, np.inf])
    states = jnp.array([[-0.3, -5.0, -0.3, -9.0], [0.4, 2.5, 2.5, 9.0], [0.0, 2.0, 1.2, 0.0]])
    np.testing.assert_allclose(
        _folded(states, bounds), [[0.3, -5.0, 0.3, -9.0], [0.4, 1.5, 1.5, 9.0], [0.0, 2.0, 1.2, 0.0]], rtol=1e-6
    )
    # mirrored at both bounds it is still below the lower one, and is put on that
    assert _folded(jnp.full((1, 4), -5.0), bounds)[0, 2] == 0.0


@pytest.mark.parametrize("first", [False, True])
def test_the_noise_is_that_of_the_most_probable_mode(first):
    """Its step's variance grows with the state; a mode's covariance is moved by the slope."""

    def start(params, inputs):
        numpyro.sample("x", dist.Normal(0.5, 2.0))

    def move(params, state, inputs):
        numpyro.sample("x", dist.Normal(0.5 * state["x"] ** 2, jnp.sqrt(0.1 + state["x"])))

    def look(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["x"], 1.0))

    model = StateSpaceModel(start, move, look).compile()
    modes = GaussianMixture(jnp.log(jnp.array([0.2, 0.8])), jnp.array([[1.0], [3.0]]), jnp.array([[[0.2]], [[0.3]]]))
    found, noise = jax.jit(lambda first: predicted_modes(model, modes, first, None))(jnp.asarray(first))
    if first:
        assert np.exp(found.log_weights).tolist() == [1.0, 0.0]
        assert noise[0, 0] == pytest.approx(4.0) and found.means[0, 0] == pytest.approx(0.5)
    else:
        np.testing.assert_allclose(np.exp(found.log_weights), [0.2, 0.8], rtol=1e-5)
        np.testing.assert_allclose(found.means[:, 0], [0.5, 4.5], rtol=1e-5)
        np.testing.assert_allclose(found.covariances[:, 0, 0], [0.2 + 1.1, 9 * 0.3 + 3.1], rtol=1e-5)
        assert noise[0, 0] == pytest.approx(3.1)
