"""The ensemble Kalman smoother's lag: a frame takes in the data of so many later ones, and of no more."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.toys.linear_gaussian import linear_gaussian

from poseppl.smoothers import History, ensemble_kalman_smoother

FRAMES = 5
MODEL = linear_gaussian(2, 1).compile()
YS = np.random.default_rng(0).normal(scale=2.0, size=(FRAMES, 1))


def smoothed(lag, last):
    """States (T, N, d) by data up to a last frame."""
    observations = MODEL.observe({"y": np.where(np.arange(FRAMES)[:, None] <= last, YS, np.nan)})
    empty = History(jnp.zeros((FRAMES, 20, 2)), jnp.zeros((FRAMES, 20)), jnp.zeros((FRAMES, 20), int), jnp.zeros(FRAMES, bool))
    smoother = ensemble_kalman_smoother(MODEL, num_particles=20, lag=lag)
    return np.asarray(jax.jit(smoother.smooth)(jax.random.key(0), empty, observations, None).particles)


@pytest.mark.parametrize("lag", [1, 3])
def test_a_frame_knows_the_data_of_the_lag_alone(lag):
    found = smoothed(lag, FRAMES - 1)
    for t in range(FRAMES):
        np.testing.assert_allclose(found[t], smoothed(None, min(t + lag, FRAMES - 1))[t], rtol=1e-4, atol=1e-5)
    assert np.abs(found[0] - smoothed(None, FRAMES - 1)[0]).max() > 1e-3
    assert np.abs(found[0] - smoothed(None, lag - 1)[0]).max() > 1e-3
