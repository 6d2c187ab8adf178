"""The assumed density filter where the transition forgets a coordinate: what the draws become is the same for all of them."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

import poseppl
from poseppl.filters.assumed_density import draws_of_covariances

NUM_FRAMES = 30


def initial(params, inputs):
    numpyro.sample("level", dist.Normal(jnp.zeros(2), 1.0))
    numpyro.sample("shock", dist.Normal(0.0, 1.0))


def transition(params, state, inputs):
    numpyro.sample("level", dist.Normal(0.9 * state["level"], 0.5))
    numpyro.sample("shock", dist.Normal(0.0, 1.0))


def observation(params, state, inputs):
    numpyro.sample("y", dist.Normal(state["level"] + state["shock"], 0.3))


def moments(model, built, data):
    """Means and standard deviations (T, 3), and the effective draws (T,)."""
    result = poseppl.infer(model, data, built, jax.random.key(0))
    draws = [result["posterior"][name].values.reshape(-1, NUM_FRAMES, size) for name, size in (("level", 2), ("shock", 1))]
    whole = np.concatenate(draws, -1)
    return whole.mean(0), whole.std(0), np.asarray(result["sample_stats"]["ess"]).reshape(-1)


@pytest.mark.full
def test_a_site_that_is_drawn_independently_in_each_frame_agrees_with_kalman():
    model = poseppl.StateSpaceModel(initial, transition, observation).compile()
    data = {"y": np.random.default_rng(0).normal(size=(NUM_FRAMES, 2))}
    exact = poseppl.infer(model, data, poseppl.kalman_filter(model), jax.random.key(0))["summary"]
    mean, deviation, effective = moments(model, poseppl.assumed_density_filter(model), data)
    true = [
        np.concatenate([exact[f"{name}_{what}"].values.reshape(NUM_FRAMES, -1) for name in ("level", "shock")], -1)
        for what in ("mean", "sd")
    ]
    errors = (mean - true[0]) / true[1] * np.sqrt(effective)[:, None]
    assert np.sqrt((errors**2).mean()) < 2 and np.abs(errors).max() < 5
    assert 0.85 < (deviation / true[1]).mean() < 1.15


def test_covariances_of_few_draws_are_known_to_be_of_few():
    """30 chains of independent draws; a few chains that do not move count at least as many as the density needs an integral."""
    draws = jax.random.normal(jax.random.key(0), (200, 20, 5))
    # the variance of 200 means is known to 10 %, the mean over five coordinates to 4.5 %
    assert float(draws_of_covariances(draws)) == pytest.approx(4000, rel=5 * 0.045)
    still = jnp.broadcast_to(draws[:3, :1], (3, 20, 5))
    assert float(draws_of_covariances(still)) == 9.0
