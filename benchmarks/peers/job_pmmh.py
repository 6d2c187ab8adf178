"""The job of parameters by particles: posterior means of the logarithms of both deviations of the drifting level in `job`.

The first 100 frames, priors N(-0.5, 0.7^2) of log step and N(-1, 0.7^2) of log noise; chains of 5,000 updates with 200
particles, of which the first 1,000 are warm-up; SMC² with 256 params and as many particles. With so many particles the
log-likelihood's variance is about 1 at the posterior mean. The exact answer is of a Kalman filter on a grid; errors are in
posterior standard deviations.
"""

from __future__ import annotations

import job
import numpy as np

NUM_FRAMES, NUM_PARTICLES, NUM_WARMUP, NUM_DRAWS, NUM_PARAMS, NUM_RUNS = 100, 200, 1000, 4000, 256, 1
PRIOR = np.array([[-0.5, 0.7], [-1.0, 0.7]])
"""Means and standard deviations of the logarithms of step and noise."""


def draw() -> np.ndarray:
    """Data (T,)."""
    return job.draw()[:NUM_FRAMES]


def exact(data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Posterior means and standard deviations (2,)."""
    step, noise = np.meshgrid(*(mean + sd * np.linspace(-5, 5, 201) for mean, sd in PRIOR), indexing="ij")
    total = -0.5 * sum(((u - mean) / sd) ** 2 for u, (mean, sd) in zip((step, noise), PRIOR, strict=True))
    mean, variance = 0.0, 1.0
    for datum in data:
        width = variance + np.exp(2 * noise)
        total = total - 0.5 * (np.log(width) + (datum - mean) ** 2 / width)
        gain = variance / width
        mean, variance = mean + gain * (datum - mean), (1 - gain) * variance
        mean, variance = job.DECAY * mean, job.DECAY**2 * variance + np.exp(2 * step)
    weights = np.exp(total - total.max())
    weights /= weights.sum()
    means = np.array([(weights * u).sum() for u in (step, noise)])
    return means, np.sqrt([(weights * (u - m) ** 2).sum() for u, m in zip((step, noise), means, strict=True)])
