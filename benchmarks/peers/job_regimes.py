"""The job of regimes: an autoregressive hidden Markov model, y_t ~ N(a y_(t-1) + b, s^2) with a, b, s of a hidden regime.

The first regime is either with probability 1/2, and y_(-1) = 0. Wanted are the likeliest probabilities of staying, slopes,
intercepts and deviations. The exact answer is of SciPy's optimiser on the likelihood of a plain loop, and the units of errors
are the standard errors that its curvature gives.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit, logit

NUM_FRAMES = 600
STAY, SLOPES, INTERCEPTS, SCALES = (0.95, 0.9), (0.9, -0.5), (0.0, 1.0), (0.3, 0.6)
START = np.array([0.8, 0.8, 0.5, 0.0, 0.0, 0.5, 0.5, 0.5])
"""Start of searches: probabilities of staying, slopes, intercepts, deviations."""


def draw() -> np.ndarray:
    """Data (T,)."""
    rng, regime, data = np.random.default_rng(5), 0, [0.0]
    for _ in range(NUM_FRAMES):
        data.append(SLOPES[regime] * data[-1] + INTERCEPTS[regime] + SCALES[regime] * rng.normal())
        regime = regime if rng.random() < STAY[regime] else 1 - regime
    return np.array(data[1:])


def log_likelihood(values: np.ndarray, data: np.ndarray) -> float:
    """Log-likelihood of probabilities of staying, slopes, intercepts and deviations (8,)."""
    (stay, leave), slopes, intercepts, scales = np.reshape(values, (4, 2))
    moves, probability, total = np.array([[stay, 1 - stay], [1 - leave, leave]]), np.array([0.5, 0.5]), 0.0
    before = np.append(0.0, data[:-1])
    errors = (data[:, None] - slopes * before[:, None] - intercepts) / scales
    for density in np.exp(-0.5 * errors**2) / scales / np.sqrt(2 * np.pi):
        joint = probability * density
        total += np.log(joint.sum())
        probability = joint / joint.sum() @ moves
    return float(total)


def exact(data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The likeliest values (8,), and their standard errors."""

    def values(u: np.ndarray) -> np.ndarray:
        return np.concatenate([expit(u[:2]), u[2:6], np.exp(u[6:])])

    start = np.concatenate([logit(START[:2]), START[2:6], np.log(START[6:])])
    found = values(minimize(lambda u: -log_likelihood(values(u), data), start, tol=1e-9).x)
    steps = 1e-3 * np.eye(8)
    curvature = [
        [sum(i * j * log_likelihood(found + i * a + j * b, data) for i in (1, -1) for j in (1, -1)) / 4e-6 for a in steps]
        for b in steps
    ]
    return found, np.sqrt(np.diag(np.linalg.inv(-np.array(curvature))))
