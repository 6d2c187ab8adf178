"""States of filters of chains: their weights, and how many chains and draws these amount to."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.filters.chains import chain_state, effective_draws, effective_share

DRAWS = jnp.asarray(np.random.default_rng(0).normal(size=(4, 6, 2)))


def test_a_chains_weight_is_shared_among_its_draws():
    masses = np.array([0.5, 0.25, 0.125, 0.125])
    weights = np.exp(chain_state(DRAWS, jnp.zeros(()), log_weights=jnp.log(masses)).log_weights)
    np.testing.assert_allclose(weights.sum(1), masses, rtol=1e-5)
    np.testing.assert_allclose(weights, weights[:, :1] * np.ones(6))


def test_chains_of_uneven_weights_are_worth_fewer():
    assert effective_share(jnp.log(jnp.array([0.5, 0.5, 1e-30, 1e-30]))) == pytest.approx(0.5)
    assert effective_share(jnp.log(jnp.full(5, 0.2))) == pytest.approx(1.0)
    assert effective_share(jnp.log(jnp.array([0.5, 0.25, 0.25]))) == pytest.approx(1 / 0.375 / 3)


def test_draws_that_stand_still_are_worth_one_of_each_chain():
    still = jnp.broadcast_to(DRAWS[:, :1], DRAWS.shape)
    # the variance over all draws is that over chains times 3 / 4: less than one each is one each
    assert float(effective_draws(still)) == pytest.approx(4.0)
    assert float(effective_draws(DRAWS - DRAWS.mean(1, keepdims=True))) == 24.0
