from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.particles.keys import particle_keys

SIZE = 4000


def draws(key):
    one, two = jax.random.split(key)
    return jax.random.normal(one), jax.random.gamma(two, 2.0), jax.random.normal(jax.random.fold_in(one, 3))


def correlation(*columns):
    matrix = np.corrcoef(np.stack([np.ravel(column) for column in columns]))
    return np.abs(matrix - np.eye(len(columns))).max()


@pytest.mark.full
def test_particles_draw_independently():
    normal, gamma, folded = map(np.asarray, jax.jit(lambda key: jax.vmap(draws)(particle_keys(key, SIZE)))(jax.random.key(0)))
    assert len(np.unique(normal)) == SIZE
    assert len(np.unique(gamma)) > SIZE - 10
    for values, mean, variance in ((normal, 0, 1), (gamma, 2, 2), (folded, 0, 1)):
        assert abs(values.mean() - mean) < 5 * np.sqrt(variance / SIZE)
    assert correlation(normal, gamma, folded, np.roll(normal, 1)) < 5 / np.sqrt(SIZE)


@pytest.mark.full
def test_replicates_draw_independently():
    keys = jax.random.split(jax.random.key(0), 3)
    for values in jax.jit(jax.vmap(lambda key: jax.vmap(draws)(particle_keys(key, SIZE))))(keys):
        assert correlation(*np.asarray(values)) < 5 / np.sqrt(SIZE)


def test_a_replicate_draws_what_its_key_draws_alone():
    def replicate(key):
        keys = particle_keys(key, 5)
        pairs = jax.vmap(lambda key: jax.vmap(jax.random.normal)(jax.random.split(key, 2)))(keys)
        return jax.vmap(jax.random.normal)(keys), pairs

    keys = jax.random.split(jax.random.key(0), 3)
    together, alone = jax.jit(lambda keys: (jax.vmap(replicate)(keys), jax.lax.map(replicate, keys)))(keys)
    for one, other in zip(together, alone, strict=True):
        np.testing.assert_array_equal(one, other)
        assert len(np.unique(one)) == one.size


@pytest.mark.full
def test_a_loop_over_particles_draws_independently():
    normal, gamma, _ = jax.jit(lambda key: jax.lax.map(draws, particle_keys(key, SIZE)))(jax.random.key(0))
    assert len(np.unique(normal)) > SIZE - 10
    assert correlation(normal, gamma, np.roll(normal, 1)) < 5 / np.sqrt(SIZE)


def test_loops_inside_a_program_draw_independently():
    def joints(key):
        return jax.vmap(jax.random.normal)(jax.random.split(key, 4))

    values = np.asarray(jax.jit(lambda key: jax.vmap(joints)(particle_keys(key, SIZE)))(jax.random.key(0)))
    assert len(np.unique(values)) > 4 * SIZE - 40  # of 16,000 draws among 2^23 numbers, 15 +- 4 are there twice
    assert correlation(*values.T) < 5 / np.sqrt(SIZE)


@pytest.mark.full
def test_a_key_used_twice_is_noticed():
    def careless(key):
        return jax.random.normal(key) + jax.random.normal(key)

    with jax.debug_key_reuse(True), pytest.raises(jax.errors.KeyReuseError):
        jax.jit(lambda key: jax.vmap(careless)(particle_keys(key, 3)))(jax.random.key(0))


@pytest.mark.full
@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
def test_any_dtype(dtype):
    with jax.enable_x64(True):
        values = jax.vmap(lambda key: jax.random.uniform(key, dtype=dtype))(particle_keys(jax.random.key(0), 9))
    assert values.dtype == dtype
    assert len(np.unique(values)) == 9
