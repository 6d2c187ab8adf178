"""What the mixture approximation of the likelihood costs smoothers, on a linear Gaussian model whose answer is known.

    python benchmarks/likelihood_mixtures.py [--quick] [--dimension 10] [--frames 20] [--particles 1000]

The history is N draws from each exact filtering distribution, so that all error is the smoother's: that of the means (root mean
square, in smoothed standard deviations; the first row is the filter's own) and the ratio of the variances to the exact ones.
The correction "none" is the paper's fit.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.linear_gaussian import linear_gaussian
from timing import arguments, show

from poseppl.filters import kalman_filter
from poseppl.program import CompiledModel
from poseppl.runs.run import run_filter
from poseppl.runs.simulation import simulate
from poseppl.smoothers import (
    MixtureSettings,
    Smoother,
    collect_history,
    gibbs_smoother,
    smoothed_moments,
    variational_smoother,
)

UNDIVIDED, WEIGHTS, FREE = (
    MixtureSettings(correction="none"),
    MixtureSettings(correction="weights"),
    MixtureSettings(covariance="free"),
)

SMOOTHERS: Mapping[str, Callable[[CompiledModel], Smoother]] = {
    "Gibbs, K 50, none": lambda model: gibbs_smoother(model, mixture=UNDIVIDED),
    "Gibbs, K 50, weights": lambda model: gibbs_smoother(model, mixture=WEIGHTS),
    "Gibbs, K 50, moments": gibbs_smoother,
    "Gibbs on the model, K 50": lambda model: gibbs_smoother(model, target="model"),
    "variational, K 50, none, factorised": lambda model: variational_smoother(model, mixture=UNDIVIDED, factorised=True),
    "variational, K 50, none": lambda model: variational_smoother(model, mixture=UNDIVIDED),
    "variational, K 50, moments": variational_smoother,
    "variational, K 1, moments": lambda model: variational_smoother(model, num_components=1),
    "variational, K 1 free, moments": lambda model: variational_smoother(model, num_components=1, mixture=FREE),
}


def main() -> None:
    options = arguments(__doc__, dimension=10, frames=20, particles=1000)
    d, num_frames, num_particles = (2, 4, 100) if options.quick else (options.dimension, options.frames, options.particles)
    model = linear_gaussian(d).compile()
    observations = model.observe(simulate(model, jax.random.key(0), num_frames).values, frames=num_frames)
    exact = smoothed_moments(model, observations)
    mean, variance = np.asarray(exact.mean), np.diagonal(np.asarray(exact.covariance), axis1=1, axis2=2)
    history = run_filter(
        kalman_filter(model, num_particles), jax.random.key(1), observations, None, collect=collect_history
    ).outputs
    history = jax.tree.map(jnp.asarray, history)
    rows = []

    def describe(name: str, draws: jax.Array, seconds: float) -> None:
        found = np.asarray(draws, float).reshape(num_frames, -1, d)
        error = np.sqrt(np.mean((found.mean(1) - mean) ** 2 / variance))
        rows.append([name, f"{error:.2f}", f"{np.mean(found.var(1) / variance):.2f}", f"{seconds:.1f}"])

    describe("filter", history.particles, 0.0)
    for name, build in SMOOTHERS.items():
        smooth = jax.jit(build(model).smooth).lower(jax.random.key(2), history, observations, None).compile()
        start = time.perf_counter()
        smoothed = jax.block_until_ready(smooth(jax.random.key(2), history, observations, None))
        describe(name, smoothed.particles, time.perf_counter() - start)
    show(
        f"Linear Gaussian, d = {d}, T = {num_frames}, N = {num_particles}", ["", "error of means", "variance", "seconds"], rows
    )


if __name__ == "__main__":
    main()
