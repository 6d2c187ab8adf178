"""Cost of the NumPyro programs in each filter: the same filter on the same model with densities written by hand.

    python -m benchmarks.filter_overhead [--quick]

The model is linear Gaussian in ten dimensions, 100 frames. Both sides are compiled alike, into one scan over the frames.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.toys.linear_gaussian import LinearGaussian, linear_gaussian_matrices, linear_gaussian_model

from benchmarks.timing import arguments, interleave, show
from poseppl.filters import (
    Filter,
    annealed_filter,
    assumed_density_filter,
    demc_filter,
    guided_filter,
    hmc_filter,
    kalman_filter,
    particle_filter,
    tempered_filter,
)
from poseppl.filters.scan import scan_filter
from poseppl.kernels import HMCSettings
from poseppl.program import CompiledModel

DIMENSION = 10
LOG_2_PI = float(np.log(2 * np.pi))


def by_hand(model: CompiledModel, matrices: LinearGaussian) -> CompiledModel:
    """The model with every density and draw as one array expression."""
    A, _, H, _, m, _, _ = (None if part is None else jnp.asarray(part, float) for part in matrices)
    first, step, noise = (jnp.sqrt(jnp.diagonal(jnp.asarray(part, float))) for part in (matrices.P, matrices.Q, matrices.R))

    def normal(residual: jax.Array, scale: jax.Array) -> jax.Array:
        return jnp.sum(-0.5 * (residual / scale) ** 2 - jnp.log(scale)) - 0.5 * LOG_2_PI * residual.shape[0]

    class ByHand(CompiledModel):
        def sample_initial(self, rng_key: jax.Array, inputs: Any = None) -> jax.Array:
            return m + first * jax.random.normal(rng_key, (DIMENSION,))

        def log_initial(self, x: jax.Array, inputs: Any = None) -> jax.Array:
            return normal(x - m, first)

        def sample_transition(self, rng_key: jax.Array, x_previous: jax.Array, inputs: Any = None) -> jax.Array:
            return A @ x_previous + step * jax.random.normal(rng_key, (DIMENSION,))

        def log_transition(self, x: jax.Array, x_previous: jax.Array, inputs: Any = None) -> jax.Array:
            return normal(x - A @ x_previous, step)

        def log_observation(self, x: jax.Array, observation: Any, inputs: Any = None) -> jax.Array:
            return normal(observation.values["y"] - H @ x, noise)

        def initial_moments(self, inputs: Any = None) -> tuple[jax.Array, jax.Array]:
            return m, jnp.diag(first**2)

        def transition_moments(self, x_previous: jax.Array, inputs: Any = None) -> tuple[jax.Array, jax.Array]:
            return A @ x_previous, jnp.diag(step**2)

        def observation_moments(self, x: jax.Array, inputs: Any = None) -> tuple[jax.Array, jax.Array]:
            return H @ x, jnp.diag(noise**2)

        def observation_information(self, x: jax.Array, observation: Any, inputs: Any = None) -> jax.Array:
            return H.T @ (H / noise[:, None] ** 2)

    return ByHand(model.programs, model.sites, model.observation_sites, model.randomness)


FILTERS: dict[str, Callable[[CompiledModel], Filter]] = {
    "particle, N = 10,000": lambda model: particle_filter(model, 10_000),
    "guided, N = 10,000": lambda model: guided_filter(model, 10_000),
    "auxiliary, N = 10,000": lambda model: guided_filter(model, 10_000, auxiliary=True),
    "tempered, N = 500": lambda model: tempered_filter(model, 500),
    "annealed, N = 1,000": lambda model: annealed_filter(model, 1000),
    "DE-MC, N = 1,000": lambda model: demc_filter(model, 1000),
    "extended Kalman": lambda model: kalman_filter(model, 100),
    "unscented Kalman": lambda model: kalman_filter(model, 100, linearisation="unscented"),
    "HMC, 10 chains": lambda model: hmc_filter(model, 10, HMCSettings(num_leapfrog=10)),
    "assumed density, 30 chains": assumed_density_filter,
}


def scanned(filter: Filter, observations: Any) -> Callable[[jax.Array], jax.Array]:
    """All frames in one compiled scan; returns the log-evidence."""

    @jax.jit
    def run(rng_key: jax.Array) -> jax.Array:
        return jnp.sum(scan_filter(filter, rng_key, observations).outputs.log_evidence)

    return run


def main() -> None:
    quick = arguments(__doc__).quick
    matrices = linear_gaussian_matrices(DIMENSION)
    model = linear_gaussian_model(matrices).compile()
    data = np.random.default_rng(0).normal(size=(20 if quick else 100, DIMENSION))
    observations = model.observe({"y": data})
    rows = []
    for name, build in FILTERS.items():
        sides = {"program": model, "hand": by_hand(model, matrices)}
        runs = {side: partial(scanned(build(which), observations), jax.random.key(0)) for side, which in sides.items()}
        evidence = {side: float(run()) for side, run in runs.items()}
        seconds = interleave(runs, 2 if quick else 9)
        times = [f"{1e3 * seconds[side].median:.1f}" for side in runs]
        ratio = f"{seconds['program'].median / seconds['hand'].median:.2f}"
        rows.append([name, *times, ratio, *(f"{value:.1f}" for value in evidence.values())])
    columns = ["", "program ms", "hand ms", "ratio", "log-evidence, program", "hand"]
    show(f"{len(data)} frames of a linear Gaussian model, d = {DIMENSION}", columns, rows)


if __name__ == "__main__":
    main()
