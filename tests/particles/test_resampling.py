from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.particles import resampling
from poseppl.particles.resampling import (
    SCHEMES,
    Split,
    resample,
    resampling_scheme,
    running_split_sum,
    running_sum,
    split_number,
    systematic,
    systematic_draws,
    unit,
)

every_scheme = pytest.mark.parametrize("name", list(SCHEMES))
ordered_schemes = pytest.mark.parametrize("name", ["systematic", "stratified", "residual"])


compiled = jax.jit(resample, static_argnums=(2, 3))


def children(name, log_weights, num, num_replicates):
    """Numbers of children (K, N) in independent draws."""
    size = log_weights.shape[0]
    keys = jax.random.split(jax.random.key(7), num_replicates)
    draw = jax.jit(lambda keys: jax.lax.map(lambda key: jnp.bincount(resample(key, log_weights, num, name), length=size), keys))
    return np.asarray(draw(keys))


def z_scores(counts, expected):
    error = counts.std(0, ddof=1) / np.sqrt(len(counts))
    return (counts.mean(0) - expected) / np.where(error > 0, error, 1e-3)


@every_scheme
def test_unbiased(name, num=7):
    log_weights = 1.5 * jax.random.normal(jax.random.key(0), (20,))
    expected = num * jax.nn.softmax(log_weights)
    counts = children(name, log_weights, num, 2000)
    assert (counts.sum(1) == num).all()
    assert np.abs(z_scores(counts, expected)).max() < 5


@pytest.mark.full
def test_bias_is_noticed():
    """Rounding the expected numbers is what an unbiased scheme must not do."""
    log_weights = 1.5 * jax.random.normal(jax.random.key(0), (20,))
    counts = children("systematic", log_weights, 20, 2000)
    assert np.abs(z_scores(counts, np.round(20 * jax.nn.softmax(log_weights)))).max() > 20


@every_scheme
def test_spread_is_what_the_scheme_promises(name):
    log_weights = jax.random.normal(jax.random.key(1), (50,))
    expected = np.asarray(50 * jax.nn.softmax(log_weights))
    counts = children(name, log_weights, 50, 500)
    assert np.abs(z_scores(counts, expected)).max() < 5
    deviation = counts - expected
    if name == "systematic":
        assert np.abs(deviation).max() < 1 + 1e-4
    elif name == "stratified":
        assert np.abs(deviation).max() < 2 + 1e-4
    elif name == "residual":
        assert deviation.min() > -1 - 1e-4
    else:
        variance = expected * (1 - expected / 50)
        # five standard errors of a Gaussian's variance, and more for the heavy tails of rare children; found up to 0.29
        np.testing.assert_allclose(deviation.var(0), variance, rtol=5 * np.sqrt(2 / 500) + 0.15)


def test_a_sum_that_falls_short_leaves_the_last_slot_to_the_last_particle_with_weight():
    cumulative = Split(jnp.array([1.0, 2.0, 2.0]), jnp.array([0.0, 3.0, 3.0]))
    assert resampling._share_slots(cumulative, jnp.array([1.0, 2.0, 2.0]), 3).tolist() == [0, 1, 1]


def test_draws_of_several_numbers_are_those_of_each_number():
    keys, log_weights = jax.random.split(jax.random.key(5)), jax.random.normal(jax.random.key(6), (300,))
    for key, num, drawn in zip(keys, (300, 40), systematic_draws(keys, log_weights, (300, 40)), strict=True):
        np.testing.assert_array_equal(drawn, systematic(key, log_weights, num))


@pytest.mark.full
@ordered_schemes
@pytest.mark.parametrize("size", [1, 100_000])
def test_uniform_weights_keep_every_particle_once(name, size):
    for seed, level in enumerate([0.0, -3.7, 88.0]):
        np.testing.assert_array_equal(compiled(jax.random.key(seed), jnp.full(size, level), size, name), np.arange(size))


@pytest.mark.full
@every_scheme
def test_particles_without_weight_have_no_children(name):
    """At both ends, in between, and where only tiny weights stand beside them."""
    log_weights = jax.random.normal(jax.random.key(2), (5000,))
    dead = jnp.arange(5000) % 3 == 0
    dead = dead.at[:10].set(True).at[-10:].set(True)
    log_weights = jnp.where(dead, jnp.where(jnp.arange(5000) % 2 == 0, -jnp.inf, jnp.nan), log_weights)
    for seed in range(20):
        assert not dead[compiled(jax.random.key(seed), log_weights, 5000, name)].any()


@pytest.mark.full
@every_scheme
def test_one_particle_with_all_the_weight(name):
    log_weights = jnp.full(64, -jnp.inf).at[37].set(-1000.0)
    assert (compiled(jax.random.key(0), log_weights, 64, name) == 37).all()


@pytest.mark.full
@every_scheme
@pytest.mark.parametrize("bad", [-jnp.inf, jnp.nan])
def test_without_any_weight_all_count_alike(name, bad):
    ancestors = compiled(jax.random.key(0), jnp.full(64, bad), 64, name)
    assert len(np.unique(ancestors)) > 30


@every_scheme
def test_result_is_int32_of_the_asked_length(name):
    with jax.enable_x64(True):
        ancestors = jax.eval_shape(lambda: resample(jax.random.key(0), jnp.zeros(9), 5, name))
    assert ancestors.shape == (5,)
    assert ancestors.dtype == jnp.int32


@pytest.mark.full
@ordered_schemes
def test_large_sets_keep_their_precision_in_float32(name):
    """At N = 100,000 a plain float32 cumulative sum is wrong by more than a tenth of a slot, these by far less."""
    size = 100_000
    log_weights = 0.5 * jax.random.normal(jax.random.key(3), (size,))
    weights = np.exp(np.asarray(log_weights, np.float64))
    cumulative = size * np.cumsum(weights) / weights.sum()
    counts = np.bincount(np.asarray(compiled(jax.random.key(4), log_weights, size, name)), minlength=size)
    if name == "systematic":  # the offset can be read off the counts: all slots agree on one
        ends = np.cumsum(counts)[:-1]
        highest, lowest = (cumulative[:-1] - ends).max(), (cumulative[:-1] - ends).min()
        assert highest - lowest < 1 + 2e-2
    assert np.abs(np.cumsum(counts)[:-1] - cumulative[:-1]).max() < {"systematic": 1.02, "stratified": 1.02}.get(name, 2000)


@pytest.mark.parametrize("size", [1, 16, 511, 4097, 30_000])
def test_running_sums_are_exact(size):
    x = np.random.default_rng(0).integers(0, 500, size)
    np.testing.assert_array_equal(jax.jit(running_sum)(jnp.asarray(x, float)), np.cumsum(x))
    parts = split_number(1.5 * jax.random.normal(jax.random.key(1), (size,)))
    scale = unit(parts.fraction.dtype)
    sums = jax.tree.map(lambda a: np.asarray(a, float), jax.jit(running_split_sum)(parts))
    exact = np.cumsum(np.asarray(parts.whole, float) + scale * np.asarray(parts.fraction, float))
    np.testing.assert_array_equal(sums.whole + scale * sums.fraction, exact)
    assert (sums.fraction >= 0).all()
    assert (sums.fraction < 1 / scale).all()


def test_too_many_particles_for_the_precision():
    with pytest.raises(ValueError, match="jax_enable_x64"):
        jax.eval_shape(lambda: resample(jax.random.key(0), jnp.zeros(2**24), 2**24))


def test_unknown_scheme():
    with pytest.raises(ValueError, match="'sistematic'.*systematic, stratified, residual, multinomial"):
        resampling_scheme("sistematic")


def test_stratified_draws_each_slot_on_its_own():
    """Two slots over weights 1/4, 1/2, 1/4: the middle one has 0, 1 or 2 children, where systematic gives it always one."""
    log_weights, count = jnp.log(jnp.array([0.25, 0.5, 0.25])), 4000
    assert (children("systematic", log_weights, 2, count)[:, 1] == 1).all()
    found = np.bincount(children("stratified", log_weights, 2, count)[:, 1], minlength=3) / count
    np.testing.assert_allclose(found, [0.25, 0.5, 0.25], atol=5 * 0.5 / np.sqrt(count))
