"""Starts of chains in modes, of which the target's distribution is known."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from poseppl.filters.mode_chains import CANDIDATES, start_chains
from poseppl.kernels.laplace import find_modes

PRECISION = np.array([[4.0, 1.5], [1.5, 1.0]])
CENTRE = np.array([2.0, -1.0])


def starts_of(log_density, number=20_000):
    """Starts (N, 2) in the mode of a Gaussian, of a target that may be another one."""
    modes = find_modes(
        jnp.asarray(CENTRE)[None] + 0.1,
        lambda x: -0.5 * (x - CENTRE) @ PRECISION @ (x - CENTRE),
        lambda x: jnp.asarray(PRECISION),
        3,
    )
    return np.asarray(jax.jit(lambda key: start_chains(key, modes, jnp.zeros(number, int), log_density))(jax.random.key(0)))


def test_starts_in_a_gaussian_are_draws_of_it():
    found = starts_of(lambda x: 3.0 - 0.5 * (x - CENTRE) @ PRECISION @ (x - CENTRE))
    covariance = np.linalg.inv(PRECISION)
    spread = np.sqrt(np.diag(covariance))
    assert (np.abs(found.mean(0) - CENTRE) < 5 * spread / np.sqrt(len(found))).all()
    assert (np.abs(np.cov(found.T) - covariance) < 5 * np.outer(spread, spread) * np.sqrt(2 / len(found))).all()


def test_starts_keep_to_where_the_target_is():
    """Half of the Gaussian has no density: a start lies there only where all its candidates do."""
    found = starts_of(lambda x: jnp.where(x[0] > CENTRE[0], -0.5 * (x - CENTRE) @ PRECISION @ (x - CENTRE), -jnp.inf))
    share, expected = np.mean(found[:, 0] <= CENTRE[0]), 0.5**CANDIDATES
    assert abs(share - expected) < 5 * np.sqrt(expected / len(found))
