"""The job of hidden states: two, seen through Gaussians; the likeliest probabilities of staying, means and deviations.

The first state is either with probability 1/2. The exact answer is of SciPy's optimiser on the likelihood, summed over states
by a plain loop, and the units of errors are the standard errors that its curvature gives.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit, logit

NUM_FRAMES = 1000
STAY, MEANS, SCALES = (0.95, 0.9), (0.0, 1.5), (0.5, 1.0)
START = np.array([0.8, 0.8, -0.5, 1.0, 1.0, 1.0])
"""Start of searches: probabilities of staying, means, standard deviations."""


def draw() -> np.ndarray:
    """Data (T,)."""
    rng, states = np.random.default_rng(3), [0]
    for _ in range(NUM_FRAMES - 1):
        stays = rng.random() < STAY[states[-1]]
        states.append(states[-1] if stays else 1 - states[-1])
    return np.array(MEANS)[states] + np.array(SCALES)[states] * rng.normal(size=NUM_FRAMES)


def log_likelihood(values: np.ndarray, data: np.ndarray) -> float:
    """Log-likelihood of probabilities of staying, means and standard deviations (6,)."""
    (stay, leave), mean, scale = values[:2], values[2:4], values[4:]
    moves, probability, total = np.array([[stay, 1 - stay], [1 - leave, leave]]), np.array([0.5, 0.5]), 0.0
    densities = np.exp(-0.5 * ((data[:, None] - mean) / scale) ** 2) / scale / np.sqrt(2 * np.pi)
    for density in densities:
        joint = probability * density
        total += np.log(joint.sum())
        probability = joint / joint.sum() @ moves
    return float(total)


def exact(data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The likeliest values (6,), and their standard errors."""

    def values(u: np.ndarray) -> np.ndarray:
        return np.concatenate([expit(u[:2]), u[2:4], np.exp(u[4:])])

    start = np.concatenate([logit(START[:2]), START[2:4], np.log(START[4:])])
    found = values(minimize(lambda u: -log_likelihood(values(u), data), start, tol=1e-9).x)
    steps = 1e-3 * np.eye(6)
    curvature = [
        [sum(i * j * log_likelihood(found + i * a + j * b, data) for i in (1, -1) for j in (1, -1)) / 4e-6 for a in steps]
        for b in steps
    ]
    return found, np.sqrt(np.diag(np.linalg.inv(-np.array(curvature))))
