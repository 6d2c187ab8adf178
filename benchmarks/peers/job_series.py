"""The job of many series: 1,000 of 50 frames each, of the drifting level in `job`; filtered means."""

from __future__ import annotations

import numpy as np
from job import DECAY, NOISE, STEP

NUM_SERIES, NUM_FRAMES = 1000, 50


def draw() -> np.ndarray:
    """Data (S, T)."""
    rng = np.random.default_rng(3)
    state, data = rng.normal(size=NUM_SERIES), []
    for _ in range(NUM_FRAMES):
        data.append(state + NOISE * rng.normal(size=NUM_SERIES))
        state = DECAY * state + STEP * rng.normal(size=NUM_SERIES)
    return np.stack(data, 1)


def exact(data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Filtered means and standard deviations (S, T)."""
    mean, variance, means, variances = np.zeros(NUM_SERIES), 1.0, [], []
    for column in data.T:
        gain = variance / (variance + NOISE**2)
        mean, variance = mean + gain * (column - mean), (1 - gain) * variance
        means.append(mean)
        variances.append(variance)
        mean, variance = DECAY * mean, DECAY**2 * variance + STEP**2
    return np.stack(means, 1), np.broadcast_to(np.sqrt(variances), data.shape)
