"""Cost of the mixture in place of the likelihood (section 4.3) for smoothers, on a linear Gaussian model with a known answer.

The history is N draws from each exact filtering distribution, so that all error is the smoother's: that of the means (root mean
square, in smoothed standard deviations; that of the filter stands beside it), and the ratio of the variances to the exact ones.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.filters import kalman_filter
from poseppl.jobs import Job
from poseppl.motion.bodies.body import load_builder
from poseppl.program import CompiledModel
from poseppl.runs.run import run_filter
from poseppl.runs.simulation import simulate
from poseppl.smoothers import (
    MixtureSettings,
    Smoother,
    collect_history,
    gibbs_smoother,
    mixture_variational_smoother,
    smoothed_moments,
)
from poseppl_papers.experiment import Jobs, Results
from poseppl_papers.runs import timed
from poseppl_papers.tables import Table

UNDIVIDED, WEIGHTS, FREE = (
    MixtureSettings(correction="none"),
    MixtureSettings(correction="weights"),
    MixtureSettings(covariance="free"),
)
FILTER, DEFAULT = "none: the filter", "Gibbs, components divided by the prediction (the default)"
PUBLISHED = "Gibbs, the mixture of the paper, not divided"
SMOOTHERS: Mapping[str, Callable[[CompiledModel], Smoother]] = {
    PUBLISHED: lambda model: gibbs_smoother(model, mixture=UNDIVIDED),
    "Gibbs, particles divided by their prediction": lambda model: gibbs_smoother(model, mixture=WEIGHTS),
    DEFAULT: gibbs_smoother,
    "Gibbs against the model's own likelihood": lambda model: gibbs_smoother(model, target="model"),
    "variational, 50 components, not divided": lambda model: mixture_variational_smoother(model, mixture=UNDIVIDED),
    "variational, 50 components, divided": mixture_variational_smoother,
    "variational, one component, fixed": lambda model: mixture_variational_smoother(model, num_components=1),
    "variational, one component, free": lambda model: mixture_variational_smoother(model, num_components=1, mixture=FREE),
}


@dataclass(frozen=True)
class MixtureRun(Job):
    """A run of one smoother.

    Attributes:
        smoother: Its name, or :data:`FILTER`.
        dimension: Dimension of the state.
        num_frames: How many frames.
        num_particles: Draws of each filtering distribution.
    """

    smoother: str
    dimension: int
    num_frames: int
    num_particles: int

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"mixture-{self.smoother}"


def smooth_mixture(job: MixtureRun) -> dict[str, Any]:
    """Run the smoother.

    Returns:
        ``error`` of the means, ``variance``, the ratio to the exact one, and ``seconds``, compilation apart.
    """
    model, observations, exact, history = _sequence(job.dimension, job.num_frames, job.num_particles)
    particles, seconds = history.particles, 0.0
    if job.smoother != FILTER:
        smooth = jit(SMOOTHERS[job.smoother](model).smooth).lower(jax.random.key(2), history, observations, None).compile()
        smoothed, seconds = timed(smooth, jax.random.key(2), history, observations, None)
        particles = smoothed.particles
    draws: Floats = np.asarray(particles, np.float64).reshape(job.num_frames, -1, job.dimension)
    mean, variance = np.asarray(exact.mean), np.diagonal(np.asarray(exact.covariance), axis1=1, axis2=2)
    error = np.sqrt(np.mean((draws.mean(1) - mean) ** 2 / variance))
    return {"error": error, "variance": np.mean(draws.var(1) / variance), "seconds": seconds}


@lru_cache(maxsize=1)
def _sequence(dimension: int, num_frames: int, num_particles: int) -> tuple[CompiledModel, Any, Any, Any]:
    """The model, its data, the exact moments, and a history of draws from the exact filter."""
    build: Any = load_builder("poseppl_models.toys.linear_gaussian:linear_gaussian")
    model: CompiledModel = build(dimension).compile()
    observations = model.observe(simulate(model, jax.random.key(0), num_frames).values, frames=num_frames)
    filter = kalman_filter(model, num_particles)
    history = run_filter(filter, jax.random.key(1), observations, None, collect=collect_history).outputs
    return model, observations, smoothed_moments(model, observations), jax.tree.map(jnp.asarray, history)


def mixture_table(jobs: Jobs, results: Results) -> list[Table]:
    """One row a smoother."""
    rows = [(job.smoother, *(float(results[job.key][name]) for name in ("error", "variance"))) for job in jobs["mixtures"]]
    about = "Error of the smoothed means in smoothed standard deviations, and the ratio of the variances to the exact ones."
    return [Table("mixtures", ("smoother", "error", "variance"), rows, about)]
