"""Moves of a population: whitened by the curvature that its members share, however far their contexts are apart."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.kernels.moves import (
    HMC_MOVES,
    RANDOM_WALK_MOVES,
    Starts,
    evaluate,
    move_population,
    whitening_from_gradients,
    whitening_from_spread,
)

COVARIANCE = np.array([[1.0, 18.0], [18.0, 400.0]])
PRECISION = jnp.asarray(np.linalg.inv(COVARIANCE), jnp.float32)
NUM = 4000


def log_density(x, context):
    return -0.5 * (x - context) @ PRECISION @ (x - context)


@pytest.fixture(scope="module")
def population():
    """Exact draws given contexts that are spread far more widely than they are."""
    key_context, key_draw = jax.random.split(jax.random.key(0))
    contexts = 1000.0 * jax.random.normal(key_context, (NUM, 2))
    lower = jnp.asarray(np.linalg.cholesky(COVARIANCE), jnp.float32)
    return contexts + jax.random.normal(key_draw, (NUM, 2)) @ lower.T, contexts


@pytest.mark.full
def test_gradients_show_the_covariance_given_the_context(population):
    # in this file a tenth is 4.5 standard errors of a variance of 4,000 draws; found up to 0.037
    transform = whitening_from_gradients(evaluate(*population, log_density, HMC_MOVES))
    np.testing.assert_allclose(transform.scale @ transform.scale.T, COVARIANCE, rtol=0.1)


@pytest.mark.full
def test_spread_lies_between_the_covariance_and_its_half(population):
    positions, contexts = population
    wide = whitening_from_spread(positions, jnp.asarray(COVARIANCE, jnp.float32))
    np.testing.assert_allclose(wide.scale @ wide.scale.T, COVARIANCE, rtol=0.1)
    alone = whitening_from_spread(positions - contexts, jnp.asarray(COVARIANCE, jnp.float32))
    np.testing.assert_allclose(alone.scale @ alone.scale.T, 0.5 * COVARIANCE, rtol=0.1)


@pytest.mark.parametrize("settings", [HMC_MOVES, RANDOM_WALK_MOVES], ids=lambda s: s.kernel)
def test_members_keep_their_conditional_density_and_the_step_adapts(population, settings):
    def run(rng_key):
        starts = evaluate(*population, log_density, settings)
        transform = whitening_from_gradients(starts._replace(gradients=(population[1] - population[0]) @ PRECISION))
        return move_population(
            jax.random.split(rng_key, NUM), starts, log_density, transform, jnp.log(0.1), settings._replace(num_moves=20)
        )

    moved = jax.jit(run)(jax.random.key(1))
    residual = np.asarray(moved.positions[-1] - population[1], float)
    white = np.linalg.solve(np.linalg.cholesky(COVARIANCE), residual.T)
    np.testing.assert_allclose(white.mean(1), 0.0, atol=5 / np.sqrt(NUM))
    np.testing.assert_allclose(white @ white.T / NUM, np.eye(2), atol=5 * np.sqrt(2 / NUM))
    before = np.linalg.solve(np.linalg.cholesky(COVARIANCE), np.asarray(population[0] - population[1], float).T)
    assert abs(np.corrcoef(white[0], before[0])[0, 1]) < 0.2
    assert float(jnp.exp(moved.log_step_size)) > 0.5
    assert settings.target_acceptance < float(moved.acceptance) < 1.0
    counted = int(moved.num_gradient) + int(moved.num_density)
    assert counted == NUM * (1 + 20 * (4 if settings.kernel == "hmc" else 1))


@pytest.mark.full
@pytest.mark.parametrize("gradients", [0.0, jnp.nan, jnp.inf])
def test_charts_of_nothing_are_finite(gradients):
    starts = Starts(jnp.ones((3, 2)), None, jnp.zeros(3), jnp.full((3, 2), gradients))
    for transform in (whitening_from_gradients(starts), whitening_from_spread(starts.positions, jnp.zeros((2, 2)))):
        assert np.isfinite(transform.scale).all() and (np.diagonal(transform.scale) > 0).all()
