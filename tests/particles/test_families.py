"""The effective number of draws that descend from few, on samples of which the mean's true error is known."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.particles.weights import clustered_ess

NUM, RUNS, DIMENSIONS = 500, 400, 4
EFFECTIVE = jax.jit(clustered_ess)


@pytest.mark.parametrize("families", [10, 100, NUM])
@pytest.mark.parametrize("alike", [0.0, 0.3, 1.0])
def test_the_mean_errs_as_the_effective_number_says(families: int, alike: float) -> None:
    """Families of unequal masses, whose members have so much of their variance in common."""
    rng = np.random.default_rng(0)
    told, errors, variances = [], [], []
    for _ in range(RUNS):
        masses = rng.dirichlet(np.ones(families)) if families < NUM else None
        family = np.arange(NUM) if masses is None else rng.choice(families, NUM, p=masses)
        common, own = rng.standard_normal((NUM, DIMENSIONS)), rng.standard_normal((NUM, DIMENSIONS))
        draws = np.sqrt(alike) * common[family] + np.sqrt(1 - alike) * own
        told.append(1 / float(EFFECTIVE(jnp.asarray(draws, jnp.float32), jnp.asarray(family))))
        errors.append(np.square(draws.mean(0)).mean())
        variances.append(draws.var(0).mean())
    true, error = np.mean(errors) / np.mean(variances), np.std(errors) / np.sqrt(RUNS) / np.mean(variances)
    # a least error of 1 / N, and ratios of few families, add up to a fifth
    assert 0.95 * true - 4 * error < np.mean(told) < 1.3 * true + 4 * error
    assert np.max(told) <= 1


@pytest.mark.full
def test_what_is_known_exactly_and_what_nothing_tells() -> None:
    draws = jnp.asarray(np.random.default_rng(1).standard_normal((8, 3)), jnp.float32)
    assert EFFECTIVE(draws, jnp.zeros(8, jnp.int32)) == 1
    family = jnp.array([0, 0, 0, 0, 1, 1, 5, 5])
    known = draws.at[:, 1].set(3.0)
    np.testing.assert_allclose(EFFECTIVE(known, family), EFFECTIVE(known[:, ::2], family), rtol=1e-5)
    np.testing.assert_allclose(EFFECTIVE(100 * draws + 7, family), EFFECTIVE(draws, family), rtol=1e-3)
    assert EFFECTIVE(jnp.ones((1, 2)), jnp.zeros(1, jnp.int32)) == 1


@pytest.mark.parametrize("alike", [0.0, 0.5])
def test_one_large_family_among_many_of_one_member(alike: float) -> None:
    """The mean's variance is alike sum w_a^2 + (1 - alike) / N; two thousand coordinates tell it in a single sample."""
    family = np.r_[np.zeros(50, int), np.arange(1, 51)]
    masses = np.bincount(family) / 100
    rng = np.random.default_rng(2)
    common, own = rng.standard_normal((2, 100, 2000))
    draws = np.sqrt(alike) * common[family] + np.sqrt(1 - alike) * own
    true = alike * np.square(masses).sum() + (1 - alike) / 100
    variance = 1 - true  # of the sample about its own mean
    found = 1 / float(EFFECTIVE(jnp.asarray(draws, jnp.float32), jnp.asarray(family)))
    # each coordinate is measured in its own standard deviation, which the large family moves: a tenth
    np.testing.assert_allclose(found, true / variance, rtol=0.15)
