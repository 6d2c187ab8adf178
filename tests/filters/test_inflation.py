"""Correction of covariances from few draws: without it variances shrink from frame to frame.

The model is linear and Gaussian, and its state hardly moves. A covariance estimated from few draws makes an overconfident
prior, and the posterior is the prior of the next frame. Kalman's filter has the right variances.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from law_problems import run
from oracles.kalman import kalman_filter
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices, linear_gaussian_model

from poseppl.filters import assumed_density, assumed_density_filter, window, window_filter
from poseppl.kernels import HMCSettings

DIMENSION, NUM_FRAMES = 12, 30
FEW = HMCSettings(num_updates=8, num_leapfrog=6, num_warmup=2, step_size=0.6, target_acceptance=None, jitter=0.5)


def variance_ratio(build):
    """Mean of the variances of the last ten frames over Kalman's: half of the coordinates are seen, in noise."""
    identity = np.eye(DIMENSION)
    matrices = linear_gaussian_matrices(DIMENSION, DIMENSION // 2, A=identity, Q=0.01 * identity, R=np.eye(DIMENSION // 2))
    model, ys = linear_gaussian_model(matrices).compile(), np.zeros((NUM_FRAMES, DIMENSION // 2))
    exact = kalman_filter(matrices, ys).covariances[-10:]
    states, _ = jax.jit(lambda key: run(build(model), key, model.observe({"y": ys}), jnp.zeros(NUM_FRAMES)))(jax.random.key(0))
    found = np.asarray(states.particles, float)[-10:].reshape(10, -1, DIMENSION).var(1)
    return (found / np.diagonal(exact, axis1=1, axis2=2)).mean()


def default(model):
    return assumed_density_filter(model, 20, FEW, num_components=1, num_starts=2, num_mode_steps=1)


def windowed(model):
    return window_filter(model, 20, FEW, window=1, num_starts=2, num_mode_steps=1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("build", "module", "allowance", "nothing"),
    [(default, assumed_density, "draws_of_covariances", 1e4), (windowed, window, "covariance_inflation", 1.0)],
    ids=["default", "window"],
)
def test_variances_do_not_shrink(build, module, allowance, nothing, monkeypatch):
    with_allowance = variance_ratio(build)
    monkeypatch.setattr(module, allowance, lambda draws: nothing)
    without = variance_ratio(build)
    assert without < 0.75 < 0.9 < with_allowance < 2.5, (with_allowance, without)
