"""Filtering and smoothing of a scalar state by quadrature on a grid, as plain NumPy loops."""

from __future__ import annotations

import numpy as np


def grid_filter_smoother(grid, log_initial, log_transition, log_observations):
    """Exact distributions of x_0..T-1 on equally spaced points.

    Args:
        grid: Points (G,), wide enough that nothing falls outside.
        log_initial: Log-densities (G,) of the first state.
        log_transition: `t -> (G, G)`, the log-density of the state at t in each column, given that at t - 1 in each row.
        log_observations: Log-likelihoods (T, G).

    Returns:
        Filtered probabilities (T, G), smoothed probabilities (T, G), and evidence increments (T,).
    """
    width = grid[1] - grid[0]
    filtered, increments = [], []
    for t, log_likelihood in enumerate(log_observations):
        predicted = np.exp(log_initial) * width if t == 0 else filtered[-1] @ np.exp(log_transition(t)) * width
        peak = log_likelihood.max()
        joint = predicted * np.exp(log_likelihood - peak)
        increments.append(np.log(joint.sum()) + peak)
        filtered.append(joint / joint.sum())
    backward, smoothed = np.ones(len(grid)), [filtered[-1]]
    for t in range(len(filtered) - 1, 0, -1):
        log_likelihood = log_observations[t]
        backward = np.exp(log_transition(t)) @ (np.exp(log_likelihood - log_likelihood.max()) * backward)
        backward /= backward.max()
        product = filtered[t - 1] * backward
        smoothed.append(product / product.sum())
    return np.array(filtered), np.array(smoothed[::-1]), np.array(increments)


def growth_on_grid(ys, num_points=1201, half_width=45.0):
    """The growth model (variances 10 and 1, times from 1) with data ys (T,), NaN where missing: grid and what it gives."""
    grid = np.linspace(-half_width, half_width, num_points)

    def log_transition(t):
        mean = grid / 2 + 25 * grid / (1 + grid**2) + 8 * np.cos(1.2 * (t + 1))
        return -0.05 * (grid[None] - mean[:, None]) ** 2 - 0.5 * np.log(20 * np.pi)

    residuals = np.nan_to_num(np.asarray(ys, float)[:, None] - grid**2 / 20)
    seen = np.isfinite(np.asarray(ys, float))[:, None]
    log_observations = np.where(seen, -0.5 * residuals**2 - 0.5 * np.log(2 * np.pi), 0.0)
    log_initial = -0.05 * grid**2 - 0.5 * np.log(20 * np.pi)
    return grid, *grid_filter_smoother(grid, log_initial, log_transition, log_observations)
