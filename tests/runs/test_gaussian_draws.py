"""Draws that NumPy makes of a filter's and a smoother's Gaussians, against the joint Gaussian of all frames."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

import poseppl
from poseppl.smoothers import rauch_tung_striebel_smoother

A, STEP, NOISE, FRAMES, COUNT = np.array([[0.9, 0.4], [-0.3, 0.8]]), 0.5, 0.7, 4, 4000
DATA = np.random.default_rng(0).normal(size=FRAMES)


def initial(params, inputs):
    numpyro.sample("x", dist.Normal(jnp.zeros(2), 1.0).to_event(1))


def transition(params, state, inputs):
    numpyro.sample("x", dist.Normal(A @ state["x"], STEP).to_event(1))


def observation(params, state, inputs):
    numpyro.sample("z", dist.Normal(state["x"][0], NOISE))


@cache
def model():
    return poseppl.StateSpaceModel(initial, transition, observation).compile()


def exact(num_frames):
    """Mean (2 T,) and covariance of the states of so many frames given their data."""
    precision = np.zeros((num_frames, 2, num_frames, 2))
    precision[0, :, 0] += np.eye(2)
    for t in range(1, num_frames):
        row = np.zeros((2, num_frames, 2))
        row[:, t], row[:, t - 1] = np.eye(2), -A
        precision += np.einsum("iab,icd->abcd", row, row) / STEP**2
    for t in range(num_frames):
        precision[t, 0, t, 0] += 1 / NOISE**2
    covariance = np.linalg.inv(precision.reshape(2 * num_frames, -1))
    seen = np.zeros((num_frames, 2))
    seen[:, 0] = DATA[:num_frames] / NOISE**2
    return covariance @ seen.ravel(), covariance


def check(draws, mean, covariance):
    """Draws (N, d) have this mean and covariance, within five standard errors of independent draws."""
    variances = np.diagonal(covariance)
    assert np.all(np.abs(draws.mean(0) - mean) < 5 * np.sqrt(variances / len(draws)))
    error = np.sqrt((np.outer(variances, variances) + covariance**2) / len(draws))
    assert np.all(np.abs(np.cov(draws.T) - covariance) < 5 * error)


@cache
def results():
    collect = poseppl.collect_draws(model(), max_draws=COUNT)
    filtered = poseppl.infer(model(), {"z": DATA}, poseppl.kalman_filter, jax.random.key(0), collect=collect)
    smoother = rauch_tung_striebel_smoother(model(), num_draws=COUNT)
    return filtered, poseppl.smooth(filtered, smoother, jax.random.key(1), collect=collect)


@pytest.mark.parametrize("frame", range(FRAMES))
def test_draws_of_a_frame_are_of_its_posterior(frame):
    mean, covariance = exact(frame + 1)
    tree = results()[0]
    draws = tree["unconstrained_posterior/state"].values[0, :, frame]
    check(draws, mean[-2:], covariance[-2:, -2:])
    np.testing.assert_allclose(tree["summary/state_mean"].values[frame], mean[-2:], atol=1e-5)
    np.testing.assert_allclose(tree["summary/state_sd"].values[frame] ** 2, np.diagonal(covariance)[-2:], rtol=1e-4)
    np.testing.assert_array_equal(tree["posterior/x"].values[0, :, frame], draws)


def test_trajectories_are_of_the_joint_posterior():
    mean, covariance = exact(FRAMES)
    tree = results()[1]
    draws = tree["unconstrained_posterior/state"].values[0].reshape(COUNT, -1)
    check(draws, mean, covariance)
    np.testing.assert_allclose(tree["summary/x_mean"].values.ravel(), mean, atol=1e-5)
    upper = tree["summary/x_quantile"].sel(quantile=0.95).values.ravel()
    np.testing.assert_allclose(upper, mean + 1.6448536 * np.sqrt(np.diagonal(covariance)), atol=1e-4)


def test_draws_do_not_depend_on_how_a_run_is_split():
    collect, data = poseppl.collect_draws(model(), max_draws=3), model().observe({"z": DATA})
    runs = [
        poseppl.run_filter(poseppl.kalman_filter(model()), jax.random.key(2), data, collect=collect, chunk=chunk)
        for chunk in (1, 3)
    ]
    np.testing.assert_array_equal(*(run.outputs.state for run in runs))


def test_frames_have_noise_of_their_own():
    draws = results()[0]["unconstrained_posterior/state"].values[0]
    standard = (draws - draws.mean(0)) / draws.std(0)
    between = standard[:, 1].T @ standard[:, 2] / COUNT
    assert np.abs(between).max() < 5 / np.sqrt(COUNT)
