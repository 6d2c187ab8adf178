"""Starts for the search of modes: along the most uncertain directions, in units of the state, or by noise."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.kernels.mode_search import covariance_scaled, dynamic_noise, principal_axes

UNITS = np.array([1.0, 100.0, 0.01, 1.0])
TURN = np.linalg.qr(np.random.default_rng(0).normal(size=(4, 4)))[0]
WIDTHS = np.array([5.0, 2.0, 0.5, 0.1])
COVARIANCE = jnp.asarray(TURN * WIDTHS**2 @ TURN.T * UNITS[:, None] * UNITS)
MODE = jnp.asarray(UNITS * np.array([1.0, -2.0, 0.5, 3.0]))


@pytest.mark.full
def test_axes_are_the_widest_in_the_given_units():
    axes = np.asarray(principal_axes(COVARIANCE, jnp.asarray(UNITS), 2)) / UNITS
    np.testing.assert_allclose(np.abs(axes @ TURN), np.diag(WIDTHS)[:2], atol=1e-4)
    plain = np.asarray(principal_axes(COVARIANCE, jnp.ones(4), 1))[0] / UNITS
    assert abs(plain @ TURN[:, 0]) / np.linalg.norm(plain) < 0.999 or abs(np.linalg.norm(plain) - 5.0) > 0.1


def test_a_regular_pattern_lies_on_the_axes():
    """Its first ring at sqrt(s) standard deviations, on both sides of the mode; the next one nearer."""
    starts = covariance_scaled(6, jnp.asarray(UNITS), num_directions=2, stretch=9.0)(jax.random.key(0), MODE, COVARIANCE)
    along = (np.asarray(starts) - np.asarray(MODE)) / UNITS @ TURN
    np.testing.assert_allclose(np.abs(along[:4, :2]), [[15, 0], [15, 0], [0, 6], [0, 6]], atol=1e-2)
    np.testing.assert_allclose(along[0] + along[1], 0.0, atol=1e-2)
    np.testing.assert_allclose(np.abs(along[4:, :2]), [[7.5, 0], [7.5, 0]], atol=1e-2)
    np.testing.assert_allclose(along[:, 2:], 0.0, atol=1e-2)


@pytest.mark.full
def test_random_starts_have_the_stretched_covariance_of_the_subspace():
    propose = covariance_scaled(20_000, jnp.asarray(UNITS), num_directions=2, stretch=9.0, pattern="random")
    along = (np.asarray(propose(jax.random.key(1), MODE, COVARIANCE), float) - np.asarray(MODE)) / UNITS @ TURN
    np.testing.assert_allclose(along[:, :2].std(0), 3 * WIDTHS[:2], rtol=5 / 200)
    np.testing.assert_allclose(along[:, 2:], 0.0, atol=1e-2)
    assert abs(along[:, :2].std(0)[0] / WIDTHS[0] - 9.0) > 1.0  # a factor of the covariance, not of the width


@pytest.mark.full
def test_noise_is_inflated_alike_in_all_directions():
    noise = jnp.asarray(np.diag(UNITS**2))
    condensation = dynamic_noise(20_000, noise, stretch=4.0)(jax.random.key(2), MODE, COVARIANCE)
    hypotheses = dynamic_noise(20_000, noise, stretch=4.0, spread=True)(jax.random.key(3), MODE, COVARIANCE)
    for starts, variances in ((condensation, 4.0 * np.ones(4)), (hypotheses, 4.0 + WIDTHS**2)):
        along = (np.asarray(starts, float) - np.asarray(MODE)) / UNITS @ TURN
        np.testing.assert_allclose(along.std(0), np.sqrt(variances), rtol=5 / 200)
