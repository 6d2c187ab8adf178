from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from precision import DTYPES, precision

from poseppl.particles.quantiles import column_quantiles, repeated_quantiles, sort_rows


@pytest.mark.parametrize("number", [1, 2, 3, 7, 8, 100, 600])
def test_every_column_is_sorted(number):
    values = np.random.default_rng(number).normal(size=(number, 5)).astype(np.float32)
    values[: number // 2, 1] = 3.0  # ties
    values[: number // 3, 2] = np.inf
    values[number // 2 :, 3] = -np.inf
    np.testing.assert_array_equal(jax.jit(sort_rows)(values), np.sort(values, axis=0))


def test_a_network_that_leaves_out_a_stage_would_be_seen():
    """All rows of zeros and ones are sorted: then everything is (Knuth's 0-1 principle)."""
    every = ((np.arange(2**8)[:, None] >> np.arange(8)) & 1).T.astype(np.float32)
    np.testing.assert_array_equal(sort_rows(jnp.asarray(every)), np.sort(every, axis=0))


@pytest.mark.parametrize("dtype", DTYPES)
def test_quantiles_are_numpys(dtype):
    with precision(dtype):
        sample = np.random.default_rng(0).gamma(2.0, size=(601, 2, 3)).astype(dtype)
        levels = np.array([0.0, 0.05, 0.25, 0.5, 0.9, 1.0])
        found = column_quantiles(jnp.asarray(sample), jnp.asarray(levels))
        np.testing.assert_allclose(found, np.quantile(sample, levels, axis=0), rtol=200 * np.finfo(dtype).eps)


@pytest.mark.parametrize("number", [1, 7, 100])
def test_quantiles_with_repetitions_are_those_of_the_sample(number):
    rng = np.random.default_rng(number)
    values = rng.normal(size=(number, 4)).astype(np.float32)
    values[: number // 2, 1] = 3.0  # ties
    values[number // 2 :, 2] = np.inf
    counts = rng.integers(0, 5, number).astype(np.int32)
    counts[0] += 2
    levels = jnp.array([0.0, 0.05, 0.25, 0.5, 0.9, 1.0])
    found = repeated_quantiles(jnp.asarray(values), jnp.asarray(counts), int(counts.sum()), levels)
    np.testing.assert_array_equal(found, column_quantiles(jnp.asarray(np.repeat(values, counts, 0)), levels))
    missing = repeated_quantiles(jnp.asarray(values).at[0, 3].set(jnp.nan), jnp.asarray(counts), int(counts.sum()), levels)
    assert np.isnan(missing[:, 3]).all() and np.array_equal(missing[:, :3], found[:, :3], equal_nan=True)


@pytest.mark.full
def test_nan_is_reported():
    sample = jnp.array([[1.0, 1.0], [jnp.nan, 2.0], [3.0, 3.0]])
    found = np.asarray(column_quantiles(sample, jnp.array([0.5])))
    assert np.isnan(found[0, 0]) and found[0, 1] == 2.0
