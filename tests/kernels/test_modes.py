"""Modes by Gauss-Newton and whitening, on densities whose modes and masses are known."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from poseppl.kernels import find_modes, mode_log_weights, whitening
from poseppl.kernels.laplace import Modes


def square_problem():
    """x seen through its square: two modes, mirror images but for a prior that leans to the right."""
    precision, mean, data, noise = 1.0, 0.3, 4.0, 0.2

    def log_density(x):
        return -0.5 * precision * (x[0] - mean) ** 2 - 0.5 * ((x[0] ** 2 - data) / noise) ** 2

    def curvature(x):
        return jnp.reshape(precision + (2 * x[0] / noise) ** 2, (1, 1))

    return log_density, curvature


def test_both_modes_are_found_with_their_masses():
    log_density, curvature = square_problem()
    starts = jnp.array([[-1.0], [0.4], [3.0]])
    modes = find_modes(starts, log_density, curvature, 12)
    grid = np.linspace(-4, 4, 80001)
    density = np.exp(np.asarray(jax.vmap(log_density)(jnp.asarray(grid)[:, None]), float))
    left, right = (density * (grid < 0)).sum(), (density * (grid > 0)).sum()
    np.testing.assert_allclose(np.abs(np.asarray(modes.states)[:, 0]), 2.0, atol=0.01)
    masses = np.exp(np.asarray(modes.log_masses, float))
    step = grid[1] - grid[0]
    # Laplace's approximation itself is good to (curvature / precision^2), some 2 % here
    np.testing.assert_allclose(masses[[0, 1]], [left * step, right * step], rtol=0.03)


def test_density_never_falls_on_the_way():
    log_density, curvature = square_problem()
    starts = jax.random.normal(jax.random.key(0), (50, 1)) * 3
    heights = [np.asarray(jax.vmap(log_density)(starts))]
    for steps in (1, 3, 9):
        states = find_modes(starts, log_density, curvature, steps).states
        heights.append(np.asarray(jax.vmap(log_density)(states)))
    for before, after in zip(heights, heights[1:], strict=False):
        assert (after >= before - 1e-5 * np.abs(before)).all()  # rounding of float32 between two compilations


def test_whitening_makes_the_precision_the_identity():
    rng = np.random.default_rng(0)
    scales = 10.0 ** rng.uniform(-2, 2, 6)
    a = rng.normal(size=(6, 6))
    precision = (a @ a.T + np.eye(6)) * scales[:, None] * scales
    with jax.enable_x64(True):
        transform = whitening(jnp.zeros(6), jnp.asarray(precision))
        np.testing.assert_allclose(transform.scale.T @ precision @ transform.scale, np.eye(6), atol=1e-10)
        z = jnp.asarray(rng.normal(size=(4, 6)))
        np.testing.assert_allclose(transform.to_white(transform.to_state(z)), z, atol=1e-9)
        diagonal = whitening(jnp.ones(6), jnp.asarray(precision), dense=False)
        np.testing.assert_allclose(diagonal.scale, np.diag(precision) ** -0.5)
        np.testing.assert_allclose(diagonal.to_white(diagonal.to_state(z)), z, atol=1e-12)


@pytest.mark.full
def test_climbers_that_came_to_one_mode_share_its_mass():
    """Otherwise a mode would count once for each search that finds it: here the left one three times."""
    log_density, curvature = square_problem()
    starts = jnp.array([[-1.0], [-2.5], [-3.0], [3.0]])
    modes = find_modes(starts, log_density, curvature, 12)
    once = np.asarray(jax.nn.softmax(modes.log_masses[2:]))
    shared, plain = (np.asarray(jax.nn.softmax(masses)) for masses in (mode_log_weights(modes), modes.log_masses))
    # as far as the climbs converged: in one mode the Gaussians of the three are the same to some 1e-3
    np.testing.assert_allclose([shared[:3].sum(), shared[3]], once, rtol=0.01)
    assert plain[:3].sum() > 1.2 * once[0]
    assert np.abs(plain[:3].sum() - 3 * once[0] / (3 * once[0] + once[1])) < 0.01


@pytest.mark.full
def test_a_climb_that_broke_down_has_no_mass():
    log_density, curvature = square_problem()
    starts = jnp.array([[-2.0], [2.0]])
    modes = find_modes(starts, log_density, curvature, 2)
    broken = modes._replace(states=modes.states.at[0].set(jnp.nan), log_masses=modes.log_masses.at[0].set(-jnp.inf))
    shared = np.asarray(mode_log_weights(broken))
    assert shared[0] == -np.inf and np.isfinite(shared[1])


def test_shared_masses_are_importance_weights_under_the_mixture_of_the_modes():
    """Two modes of other widths that overlap: log p + log of a Gaussian's constant, less the log of the sum of both."""
    states, widths, heights = np.array([[0.0], [1.0]]), np.array([0.2, 1.5]), np.array([0.3, -0.4])
    precisions, scales = (widths**-2.0)[:, None, None], widths[:, None, None]
    masses = heights + np.log(widths) + 0.5 * np.log(2 * np.pi)
    shared = mode_log_weights(Modes(*(jnp.asarray(part, jnp.float32) for part in (states, precisions, scales, masses))))
    mixture = scipy.stats.norm(states[:, 0], widths).pdf(states).sum(1)
    np.testing.assert_allclose(shared, heights - np.log(mixture), rtol=1e-5)
