"""The gradient job: log-likelihood of a linear model in 4 dimensions over 1,000 frames, and its derivatives by two parameters.

x_0 ~ N(0, I), x_t ~ N(decay R x_(t-1), 0.3 I) with a rotation R, z_t ~ N(x_t, noise^2 I); parameters decay and log noise.
"""

from __future__ import annotations

import numpy as np

DIMENSION, VARIANCE, NUM_FRAMES, DECAY, LOG_NOISE = 4, 0.3, 1000, 0.9, -0.5


def rotation() -> np.ndarray:
    """R (d, d): two planes turned by 0.3 and 0.7 radians."""
    turned = np.zeros((DIMENSION, DIMENSION))
    for start, angle in ((0, 0.3), (2, 0.7)):
        c, s = np.cos(angle), np.sin(angle)
        turned[start : start + 2, start : start + 2] = [[c, -s], [s, c]]
    return turned


def draw() -> np.ndarray:
    """Data (T, d)."""
    rng, turned, data = np.random.default_rng(2), rotation(), []
    state = rng.normal(size=DIMENSION)
    for _ in range(NUM_FRAMES):
        data.append(state + np.exp(LOG_NOISE) * rng.normal(size=DIMENSION))
        state = DECAY * turned @ state + np.sqrt(VARIANCE) * rng.normal(size=DIMENSION)
    return np.array(data)


def exact(data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Value and derivatives (3,) by central differences of a Kalman filter in NumPy, and their sizes."""
    step = 1e-5
    value = evidence(data, DECAY, LOG_NOISE)
    by_decay = evidence(data, DECAY + step, LOG_NOISE) - evidence(data, DECAY - step, LOG_NOISE)
    by_noise = evidence(data, DECAY, LOG_NOISE + step) - evidence(data, DECAY, LOG_NOISE - step)
    found = np.array([value, by_decay / (2 * step), by_noise / (2 * step)])
    return found, np.abs(found)


def evidence(data: np.ndarray, decay: float, log_noise: float) -> float:
    """Log-likelihood of the data."""
    A, total = decay * rotation(), 0.0
    mean, covariance = np.zeros(DIMENSION), np.eye(DIMENSION)
    for row in data:
        spread = covariance + np.exp(2 * log_noise) * np.eye(DIMENSION)
        apart = row - mean
        total -= 0.5 * (apart @ np.linalg.solve(spread, apart) + np.linalg.slogdet(2 * np.pi * spread)[1])
        gain = np.linalg.solve(spread, covariance).T
        mean, covariance = mean + gain @ apart, covariance - gain @ covariance
        mean, covariance = A @ mean, A @ covariance @ A.T + VARIANCE * np.eye(DIMENSION)
    return float(total)
