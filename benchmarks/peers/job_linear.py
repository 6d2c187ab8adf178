"""The job in 28 dimensions: x_0 ~ N(0, I), x_t ~ N(A x_(t-1), 0.1 I), z_t ~ N(the first half of x_t, 0.1 I); smoothed means."""

from __future__ import annotations

import numpy as np

DIMENSION, SEEN, VARIANCE, NUM_FRAMES, NUM_DRAWS = 28, 14, 0.1, 100, 200


def matrix() -> np.ndarray:
    """A (d, d), random, of spectral radius 0.9."""
    A = np.random.default_rng(0).normal(size=(DIMENSION, DIMENSION))
    return A * (0.9 / np.abs(np.linalg.eigvals(A)).max())


def draw() -> np.ndarray:
    """Data (T, d / 2)."""
    rng, A, data = np.random.default_rng(1), matrix(), []
    state = rng.normal(size=DIMENSION)
    for _ in range(NUM_FRAMES):
        data.append(state[:SEEN] + np.sqrt(VARIANCE) * rng.normal(size=SEEN))
        state = A @ state + np.sqrt(VARIANCE) * rng.normal(size=DIMENSION)
    return np.array(data)


def exact(data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed means and standard deviations (T, d), from the joint Gaussian's precision matrix."""
    A, one = matrix(), np.eye(DIMENSION)
    seen = np.diag(np.arange(DIMENSION) < SEEN) / VARIANCE
    precision = np.zeros((NUM_FRAMES, DIMENSION, NUM_FRAMES, DIMENSION))
    for t in range(NUM_FRAMES):
        precision[t, :, t] = seen + (one / VARIANCE if t else one)
        if t:
            precision[t - 1, :, t - 1] += A.T @ A / VARIANCE
            precision[t, :, t - 1], precision[t - 1, :, t] = -A / VARIANCE, -A.T / VARIANCE
    size = NUM_FRAMES * DIMENSION
    covariance = np.linalg.inv(precision.reshape(size, size))
    information = np.pad(data, ((0, 0), (0, DIMENSION - SEEN))).ravel() / VARIANCE
    return (covariance @ information).reshape(data.shape[0], -1), np.sqrt(np.diagonal(covariance)).reshape(data.shape[0], -1)
