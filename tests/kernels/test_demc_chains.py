"""DE-MC leaves its density invariant, update by update, however few the members: against the moments of a banana."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from curved_density import CURVE, banana, z_scores

from poseppl.kernels import DEMCSettings, demc, demc_chains

NUM, UPDATES, REPLICATES = 6, 8, 8000


def draw_banana(rng_key, shape):
    """Exact draws."""
    noise = jax.random.normal(rng_key, (*shape, 2))
    x = noise[..., 0]
    return jnp.stack([x, CURVE * (x**2 - 1.0) + 0.5 * noise[..., 1]], -1)


def after_updates(settings, number=NUM, log_density=banana):
    """Members (K, N, d) of many small populations that start as exact draws."""
    key_start, key_run = jax.random.split(jax.random.key(0))
    starts = draw_banana(key_start, (REPLICATES, number))
    settings = settings._replace(num_updates=UPDATES, num_warmup=UPDATES - 1)
    run = jax.jit(jax.vmap(lambda key, x: demc_chains(key, x, log_density, settings)))
    return run(jax.random.split(key_run, REPLICATES), starts)


EXACT = {
    "plain": (DEMCSettings(), NUM),
    "much noise, snooker and jumps, odd": (DEMCSettings(noise=0.5, scale=0.4, snooker=0.3, jump=0.2), 5),
}


@pytest.mark.full
@pytest.mark.parametrize("name", EXACT)
def test_the_density_is_invariant_for_few_members(name):
    chains = after_updates(*EXACT[name])
    assert np.abs(z_scores(chains.draws[:, :, -1])).max() < 5
    assert 0.05 < float(chains.acceptance.mean()) < 0.9


@pytest.mark.full
def test_another_density_is_noticed():
    assert np.abs(z_scores(after_updates(DEMCSettings(), log_density=lambda x: 0.8 * banana(x)).draws[:, :, -1])).max() > 10


@pytest.mark.full
def test_moves_without_metropolis_are_noticed():
    assert np.abs(z_scores(after_updates(DEMCSettings(), log_density=lambda x: 0.0 * x[0]).draws[:, :, -1])).max() > 10


@pytest.mark.full
def test_noise_that_is_not_symmetric_is_noticed(monkeypatch):
    one_sided = lambda key, width, x: width * jax.random.uniform(key, x.shape, x.dtype)  # noqa: E731
    monkeypatch.setattr(demc, "symmetric_noise", one_sided)
    assert np.abs(z_scores(after_updates(DEMCSettings(noise=0.5, scale=0.4)).draws[:, :, -1])).max() > 10


@pytest.mark.full
def test_snooker_without_its_factor_is_noticed(monkeypatch):
    original = demc._snooker
    monkeypatch.setattr(demc, "_snooker", lambda *arguments: (original(*arguments)[0], 0.0))
    assert np.abs(z_scores(after_updates(DEMCSettings(snooker=1.0)).draws[:, :, -1])).max() > 10


@pytest.mark.full
def test_all_members_at_once_is_noticed(monkeypatch):
    """The pool of a member's step must not move with it: the whole population as its own pool is not exact."""

    def at_once(rng_key, members, log_density, settings, *, min_noise=0.0, noise_factor=1.0):
        pool = members.positions
        noise = settings.noise * jnp.std(pool, 0)
        return demc.move_members(rng_key, members, pool, pool.shape[0], log_density, settings, noise)

    monkeypatch.setattr(demc, "demc_update", at_once)
    assert np.abs(z_scores(after_updates(DEMCSettings()).draws[:, :, -1])).max() > 6


def long_run(settings, number, replicates=30):
    keys = jax.random.split(jax.random.key(5), replicates)
    run = lambda key: demc_chains(key, jax.random.normal(key, (number, 2)), banana, settings).draws  # noqa: E731
    return jax.jit(lambda keys: jax.lax.map(run, keys))(keys)


@pytest.mark.full
def test_past_states_converge_with_few_members():
    settings = DEMCSettings(num_updates=1500, num_warmup=500, past_states=True, snooker=0.1)
    draws = long_run(settings, 3)
    assert np.abs(z_scores(draws.reshape(30, -1, 2))).max() < 5


@pytest.mark.full
def test_members_find_the_scale_and_the_correlation():
    """From a population a hundred times too narrow, with the noise that this allows, to the density's own spread."""
    settings = DEMCSettings(num_updates=400, num_warmup=300)
    covariance = np.array([[1.0, 0.99 * 50], [0.99 * 50, 50.0**2]])
    precision = jnp.asarray(np.linalg.inv(covariance), jnp.float32)
    starts = 0.01 * jax.random.normal(jax.random.key(0), (60, 2))
    chains = jax.jit(lambda key: demc_chains(key, starts, lambda x: -0.5 * x @ precision @ x, settings))(jax.random.key(1))
    found = np.cov(np.asarray(chains.draws).reshape(-1, 2).T)
    # 60 members, each of a few independent draws: the standard error of a variance is about a tenth
    np.testing.assert_allclose(found / covariance, 1.0, atol=0.5)
    assert int(chains.num_density) == 60 * 401


@pytest.mark.full
@pytest.mark.parametrize(("number", "past_states"), [(1, False), (2, True), (3, False)])
def test_few_and_equal_members(number, past_states):
    settings = DEMCSettings(num_updates=20, snooker=0.3, past_states=past_states)
    run = jax.jit(partial(demc_chains, log_density=banana, settings=settings))
    starts = jnp.ones((number, 2))
    still = run(jax.random.key(0), starts)
    assert (np.asarray(still.draws) == 1.0).all()
    moving = run(jax.random.key(0), starts, min_noise=0.5)
    assert np.isfinite(moving.draws).all() and np.isfinite(moving.values).all()
    assert np.asarray(moving.draws)[:, -1].std() > 0


@pytest.mark.full
def test_impossible_places_are_never_entered_and_are_left():
    def half(x):
        return jnp.where(x[0] > 0, banana(x), jnp.nan)

    starts = jax.random.normal(jax.random.key(1), (40, 2))
    chains = demc_chains(jax.random.key(0), starts, half, DEMCSettings(num_updates=60, snooker=0.2))
    outside = np.asarray(chains.draws)[..., 0] <= 0
    assert not outside[:, -1].any()
    assert not (~outside[:, :-1] & outside[:, 1:]).any()


@pytest.mark.full
@pytest.mark.parametrize(
    "wrong",
    [{"num_updates": 0}, {"num_warmup": 30}, {"noise": 1.0}, {"noise": -0.1}, {"scale": 0.0}, {"jump": 1.1}, {"snooker": -0.1}],
    ids=str,
)
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        DEMCSettings(**wrong).check()
