"""The job: x_0 ~ N(0, 1), x_t ~ N(0.9 x_(t-1), 0.5^2), z_t ~ N(x_t, 0.3^2); its data, and the exact smoothed means."""

from __future__ import annotations

import numpy as np

DECAY, STEP, NOISE, NUM_FRAMES, NUM_PARTICLES = 0.9, 0.5, 0.3, 200, 1000


def draw() -> np.ndarray:
    """Data (T,)."""
    rng = np.random.default_rng(0)
    state, data = rng.normal(), []
    for _ in range(NUM_FRAMES):
        data.append(state + NOISE * rng.normal())
        state = DECAY * state + STEP * rng.normal()
    return np.array(data)


def exact(data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed means and standard deviations (T,), from the joint Gaussian's precision matrix."""
    diagonal = np.full(NUM_FRAMES, (1 + DECAY**2) / STEP**2 + 1 / NOISE**2)
    diagonal[0] = 1 + DECAY**2 / STEP**2 + 1 / NOISE**2
    diagonal[-1] = 1 / STEP**2 + 1 / NOISE**2
    beside = np.full(NUM_FRAMES - 1, -DECAY / STEP**2)
    covariance = np.linalg.inv(np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1))
    return covariance @ data / NOISE**2, np.sqrt(np.diagonal(covariance))
