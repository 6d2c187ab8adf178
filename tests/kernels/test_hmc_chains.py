"""HMC chains leave their density invariant: against the moments of a banana, and with settings that must be refused."""

from __future__ import annotations

import blackjax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from curved_density import banana, z_scores

from poseppl.kernels import CustomKernel, HMCSettings, hmc_chains
from poseppl.kernels.adapted_chain import unchecked

SETTINGS = HMCSettings(num_updates=2000, num_leapfrog=12, num_warmup=200, step_size=0.3, jitter=0.5)


def run(log_density, settings=SETTINGS, num_chains=40, seed=0):
    starts = jax.random.normal(jax.random.key(seed + 1), (num_chains, 2))
    return jax.jit(lambda k: hmc_chains(k, starts, log_density, jnp.log(settings.step_size), settings))(jax.random.key(seed))


@pytest.mark.full
def test_moments_of_a_banana():
    assert np.abs(z_scores(run(banana).draws)).max() < 5


@pytest.mark.full
def test_a_fixed_step_and_length():
    fixed = SETTINGS._replace(target_acceptance=None, jitter=0.0, num_leapfrog=7)
    assert np.abs(z_scores(run(banana, fixed).draws)).max() < 5


MALA = CustomKernel(blackjax.mala.init, blackjax.mala.build_kernel())
NUTS = CustomKernel(
    blackjax.nuts.init,
    lambda key, state, density, step: blackjax.nuts.build_kernel()(unchecked(key), state, density, step, jnp.ones(2), 4),
)


@pytest.mark.full
@pytest.mark.parametrize(("own", "acceptance"), [(MALA, 0.6), pytest.param(NUTS, 0.8, marks=pytest.mark.slow)])
def test_kernels_of_ones_own_match_quadrature(own, acceptance):
    chains = run(banana, SETTINGS._replace(own=own, target_acceptance=acceptance, step_size=0.1))
    assert np.abs(z_scores(chains.draws)).max() < 5
    assert abs(float(chains.acceptance) - acceptance) < 0.1


def test_a_kernel_without_acceptance_keeps_its_step_size():
    still = CustomKernel(MALA.init, lambda key, state, density, step: (state, None))
    chains = run(banana, SETTINGS._replace(own=still, num_updates=3, num_warmup=1), num_chains=2)
    assert float(chains.log_step_size) == np.float32(np.log(SETTINGS.step_size))
    assert float(chains.acceptance) == 1.0 and int(chains.num_gradient) == 2 * (1 + 3)


@pytest.mark.full
def test_a_wider_density_is_noticed():
    assert np.abs(z_scores(run(lambda x: 0.8 * banana(x)).draws)).max() > 10


@pytest.mark.full
def test_step_size_adapts_to_the_acceptance_rate():
    settings = HMCSettings(num_updates=400, num_leapfrog=10, num_warmup=200, step_size=0.02, target_acceptance=0.85, jitter=0.3)
    starts = jax.random.normal(jax.random.key(3), (10, 28))
    chains = hmc_chains(jax.random.key(4), starts, lambda x: -0.5 * jnp.sum(x * x), jnp.log(0.02), settings)
    assert 0.80 < float(chains.acceptance) < 0.90
    assert chains.draws.shape == (10, 200, 28)
    assert float(chains.log_step_size) > np.log(0.2)


def test_the_step_size_stays_once_the_draws_count():
    """Without a warm-up it is the one given, however far the acceptance is from its target."""
    settings = HMCSettings(num_updates=20, num_leapfrog=5, num_warmup=0, step_size=0.02, target_acceptance=0.1)
    chains = run(banana, settings, num_chains=3)
    assert float(chains.acceptance) > 0.9
    assert float(chains.log_step_size) == np.float32(np.log(0.02))
    assert float(run(banana, settings._replace(num_warmup=5), num_chains=3).log_step_size) > np.log(0.03)


def test_number_of_gradients_is_counted():
    settings = HMCSettings(num_updates=6, num_leapfrog=5, num_warmup=2, target_acceptance=None)
    chains = run(banana, settings, num_chains=3)
    assert int(chains.num_gradient) == 3 * (1 + 6 * 5)


@pytest.mark.full
def test_nan_density_is_never_accepted():
    def half(x):
        return jnp.where(x[0] > 0, banana(x), jnp.nan)

    settings = SETTINGS._replace(num_updates=300)
    starts = jnp.abs(jax.random.normal(jax.random.key(1), (10, 2)))
    draws = hmc_chains(jax.random.key(0), starts, half, jnp.log(0.3), settings).draws
    assert np.isfinite(np.asarray(draws)).all()
    assert (np.asarray(draws)[..., 0] > 0).all()


@pytest.mark.full
@pytest.mark.parametrize(
    "wrong",
    [
        {"num_updates": 0},
        {"num_leapfrog": 0},
        {"num_warmup": 32},
        {"num_warmup": -1},
        {"step_size": 0.0},
        {"step_size": float("nan")},
        {"target_acceptance": 1.0},
        {"jitter": 1.0},
    ],
    ids=str,
)
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        HMCSettings(**wrong).check()
