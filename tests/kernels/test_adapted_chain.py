"""Chains with a warm-up: its draws are thrown away, and its step size is kept."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.kernels.adapted_chain import ChainSettings, adapted_chain, trajectory_lengths

FAR = 60.0


def normal(x: jax.Array) -> jax.Array:
    return -0.5 * jnp.sum(x * x)


def chain_from_afar(kernel, num_draws=60, num_warmup=60):
    """Three chains on a standard normal in five dimensions, begun 60 standard deviations away in each."""
    settings = ChainSettings(num_draws, num_warmup, kernel=kernel, num_leapfrog=8, max_doublings=5).check()
    lengths = trajectory_lengths(jax.random.key(1), settings)
    starts = jnp.full((3, 5), FAR)
    keys = jax.random.split(jax.random.key(0), 3)
    return jax.jit(jax.vmap(lambda key, start: adapted_chain(key, start, normal, settings, lengths)))(keys, starts)


@pytest.mark.parametrize("kernel", ["nuts", "hmc"])
def test_the_way_from_the_start_is_not_among_the_draws(kernel):
    chains = chain_from_afar(kernel)
    assert chains.draws.shape == (3, 60, 5)
    # 900 normal values: beyond 5.5 once in 30,000 such sets; the warm-up came from 60
    assert np.abs(chains.draws).max() < 5.5
    assert (np.asarray(chains.acceptance) > 0.6).all()


def test_the_step_size_of_the_warm_up_stays():
    """However many draws follow."""
    few, many = (chain_from_afar("hmc", num_draws=number) for number in (2, 40))
    np.testing.assert_array_equal(few.step_size, many.step_size)
    start = chain_from_afar("hmc", num_draws=20, num_warmup=0)
    assert np.ptp(np.asarray(start.step_size)) == 0.0
