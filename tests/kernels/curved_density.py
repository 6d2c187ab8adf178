"""A banana, and how far the means of draws are from its moments."""

from __future__ import annotations

import jax
import numpy as np
import scipy.stats

CURVE = 0.5
# x is a standard normal, and y = (x^2 - 1) / 2 + N(0, 1/4)
MOMENTS = np.array([0.0, 0.0, 1.0, 0.75, 1.0, 2 * scipy.stats.norm.sf(1.5)])


def banana(x: jax.Array) -> jax.Array:
    return -0.5 * (x[0] ** 2 + (x[1] - CURVE * (x[0] ** 2 - 1.0)) ** 2 / 0.25)


def features(draws):
    x, y = draws[..., 0], draws[..., 1]
    return np.stack([x, y, x**2, y**2, x**2 * y, np.abs(x) > 1.5], -1)


def z_scores(draws):
    """Chains or populations (K, N, 2) are independent: their means give the standard error, whatever goes on within them."""
    means = features(np.asarray(draws, float)).mean(1)
    return (means.mean(0) - MOMENTS) / (means.std(0, ddof=1) / np.sqrt(len(means)))
