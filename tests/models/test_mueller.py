"""Mueller's surface: its minima and saddles from the literature, and DE-MC on it against quadrature."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from law_problems import independent
from oracles.quadrature import moments_on_grid
from poseppl_models.toys.mueller import MINIMA, mueller_log_density, mueller_potential

from poseppl.kernels import DEMCSettings, demc_chains

pytestmark = pytest.mark.full

TEMPERATURE = 40.0


def test_minima_and_saddles():
    points = jnp.array([*MINIMA, (-0.822002, 0.624313), (0.212487, 0.292988)])
    np.testing.assert_allclose(mueller_potential(points), [-146.6995, -108.1667, -80.7678, -40.6648, -72.2489], atol=1e-2)
    gradients = jax.vmap(jax.grad(mueller_potential))(points)
    np.testing.assert_allclose(gradients, 0.0, atol=0.05)
    bends = np.linalg.eigvalsh(np.asarray(jax.vmap(jax.hessian(mueller_potential))(points)))
    assert (bends[:3] > 0).all() and (bends[3:].prod(1) < 0).all()


def moments(log_density):
    axes = (np.linspace(-2.5, 1.9, 500), np.linspace(-1.2, 2.9, 500))
    _, mean, _ = moments_on_grid(lambda points: log_density(jnp.asarray(points, jnp.float32)), axes)
    return mean


def test_demc_from_one_basin_converges_to_quadrature():
    """At a temperature at which the barriers are passed within the run."""
    settings = DEMCSettings(num_updates=300, num_warmup=100, snooker=0.1)

    def density(x):
        return mueller_log_density(x, TEMPERATURE)

    def one(rng_key):
        key_start, key_run = jax.random.split(rng_key)
        starts = jnp.array(MINIMA[1]) + 0.05 * jax.random.normal(key_start, (60, 2))
        return jnp.mean(demc_chains(key_run, starts, density, settings).draws, (0, 1))

    means = np.asarray(independent(one, 20), float)
    error = means.std(0, ddof=1) / np.sqrt(len(means))
    assert (np.abs(means.mean(0) - moments(density)) < 5 * error).all()
    assert (np.abs(means.mean(0) - moments(lambda x: mueller_log_density(x, 0.7 * TEMPERATURE))) > 10 * error).any()
