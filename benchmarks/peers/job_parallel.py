"""The job of a long series: smoothed means of the 4-dimensional rotation of `job_gradient` over 10,000 frames, in float32."""

from __future__ import annotations

import numpy as np
from job_gradient import DECAY, DIMENSION, LOG_NOISE, VARIANCE, rotation

NUM_FRAMES = 10_000


def draw() -> np.ndarray:
    """Data (T, d)."""
    rng, turned, data = np.random.default_rng(6), rotation(), []
    state = rng.normal(size=DIMENSION)
    for _ in range(NUM_FRAMES):
        data.append(state + np.exp(LOG_NOISE) * rng.normal(size=DIMENSION))
        state = DECAY * turned @ state + np.sqrt(VARIANCE) * rng.normal(size=DIMENSION)
    return np.array(data, np.float32)


def exact(data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed means and standard deviations (T, d), by Kalman and Rauch-Tung-Striebel recursions in float64."""
    A, one, filtered, predicted = DECAY * rotation(), np.eye(DIMENSION), [], []
    mean, covariance = np.zeros(DIMENSION), one
    for row in data.astype(np.float64):
        predicted.append((mean, covariance))
        gain = np.linalg.solve(covariance + np.exp(2 * LOG_NOISE) * one, covariance).T
        mean, covariance = mean + gain @ (row - mean), covariance - gain @ covariance
        filtered.append((mean, covariance))
        mean, covariance = A @ mean, A @ covariance @ A.T + VARIANCE * one
    means, deviations = [mean := filtered[-1][0]], [np.sqrt(np.diagonal(covariance := filtered[-1][1]))]
    for (m, P), (a, S) in zip(filtered[-2::-1], predicted[:0:-1], strict=True):
        gain = np.linalg.solve(S, A @ P).T
        mean, covariance = m + gain @ (mean - a), P + gain @ (covariance - S) @ gain.T
        means.append(mean)
        deviations.append(np.sqrt(np.diagonal(covariance)))
    return np.array(means[::-1]), np.array(deviations[::-1])
