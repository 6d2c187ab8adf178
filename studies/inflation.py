"""The purpose of the default tracker's heavier tails: its intervals with and without, where the answer is known.

    python -m studies.inflation [--sequences 8] [--frames 60]

The model is a random walk in 28 dimensions; 14 are seen, with noise ten times as large as a step. The assumed-density filter
runs at its defaults (30 chains of 24 updates) with one Gaussian and with three. The table has the coverage of central 90 %
intervals over the later half of the frames, and the ratio of the variance to Kalman's, each with its standard error over
sequences.
"""

from __future__ import annotations

import argparse
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices, linear_gaussian_model

from poseppl.filters import assumed_density, assumed_density_filter, kalman_filter
from poseppl.filters.scan import scan_filter
from poseppl.program import CompiledModel, Observation

DIMENSION, SEEN, STEP = 28, 14, 0.1


def draw_sequence(matrices: Any, num_frames: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """States (T, d) and data (T, k) of the model."""
    rng = np.random.default_rng(seed)
    steps = np.sqrt(np.diagonal(matrices.Q)) * rng.normal(size=(num_frames, DIMENSION))
    steps[0] = rng.normal(size=DIMENSION)
    states = steps.cumsum(0)
    return states, states @ matrices.H.T + rng.normal(size=(num_frames, SEEN))


def run(filter: Any, model: CompiledModel, data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means and variances (sequence, T, d) of the filter's states."""

    def one(row: Any) -> Any:
        rng_key, ys = row
        observations = Observation({"y": ys}, {"y": jnp.ones(ys.shape, bool)})
        return scan_filter(filter, rng_key, observations, collect=moments).outputs

    def moments(rng_key: Any, state: Any, info: Any, inputs: Any) -> tuple[jax.Array, jax.Array]:
        if hasattr(state, "posterior"):
            return state.posterior.mean, jnp.diagonal(state.posterior.covariance)
        draws = state.particles.reshape(-1, DIMENSION)
        return jnp.mean(draws, 0), jnp.var(draws, 0)

    keys = jax.random.split(jax.random.key(0), len(data))
    found = jax.jit(lambda rows: jax.lax.map(one, rows))((keys, jnp.asarray(data, jnp.float32)))
    return tuple(np.asarray(part, float) for part in found)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sequences", type=int, default=8)
    parser.add_argument("--frames", type=int, default=60)
    options = parser.parse_args()
    identity = np.eye(DIMENSION)
    matrices = linear_gaussian_matrices(DIMENSION, SEEN, A=identity, Q=STEP**2 * identity, R=np.eye(SEEN), P=identity)
    model = linear_gaussian_model(matrices).compile()
    sequences = [draw_sequence(matrices, options.frames, seed) for seed in range(options.sequences)]
    states, data = (np.stack(part) for part in zip(*sequences, strict=True))
    late = slice(options.frames // 2, None)
    exact = run(kalman_filter(model, 2), model, data)
    estimated = assumed_density.draws_of_covariances

    def show(name: str, means: np.ndarray, variances: np.ndarray) -> None:
        inside = (np.abs(states - means) < 1.6449 * np.sqrt(variances))[:, late].mean((1, 2))
        ratio = (variances / exact[1])[:, late].mean((1, 2))
        error = [part.std(ddof=1) / np.sqrt(len(part)) for part in (inside, ratio)]
        print(
            f"{name:34} covers {inside.mean():.3f} +- {error[0]:.3f}, variance {ratio.mean():.2f} +- {error[1]:.2f}", flush=True
        )

    show("Kalman", *exact)
    for components in (1, 2, 3):
        for label, count in (("a few draws", estimated), ("exact", lambda residuals: 1e4)):
            assumed_density.draws_of_covariances = count
            built = assumed_density_filter(model, num_components=components)
            show(f"{components} components, covariances {label}", *run(built, model, data))


if __name__ == "__main__":
    main()
