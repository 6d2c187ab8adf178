"""Moments of densities by plain quadrature on a grid."""

from __future__ import annotations

import numpy as np


def moments_on_grid(log_density, axes):
    """log of the integral, mean (d,) and covariance (d, d) of exp(log_density) on equally spaced axes.

    `log_density` takes points (n, d) and returns (n,).
    """
    points = np.stack([g.ravel() for g in np.meshgrid(*axes, indexing="ij")], -1)
    values = np.asarray(log_density(points), float)
    peak = values.max()
    weights = np.exp(values - peak)
    cell = np.prod([axis[1] - axis[0] for axis in axes])
    log_integral = peak + np.log(weights.sum() * cell)
    weights /= weights.sum()
    mean = weights @ points
    centred = points - mean
    return log_integral, mean, (centred * weights[:, None]).T @ centred
