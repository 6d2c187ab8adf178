"""Who finds the basins of Mueller's surface: DE-MC and others, from one basin, at an equal number of evaluations.

    python benchmarks/mueller.py [--quick] [--members 200] [--iterations 30] [--runs 20]

The setting of Du and Guan 2006, section 2.2, Fig. 2b: 200 samples that start in one basin, the second deepest, make 30
iterations, 6,000 evaluations of the density (a gradient counts as one). The share of the samples in each basin, after the last
iteration, is the mean over runs with its standard error; quadrature on a grid gives the true shares. A sampler that starts from
one basin has to cross barriers; tempered SMC starts from a broad normal distribution instead, with as many particles.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.mueller import MINIMA, mueller_log_density, mueller_potential
from timing import arguments, show

from poseppl.filters.tempering import Tempering, temper
from poseppl.kernels import HMC_MOVES, DEMCSettings, HMCSettings, demc_chains, hmc_chains
from poseppl.particles.resampling import systematic

START, START_SPREAD = jnp.array(MINIMA[1]), 0.05
BROAD_CENTRE, BROAD_SPREAD = jnp.array([0.0, 0.75]), 0.75
LOW, HIGH, POINTS = np.array([-2.0, -0.8]), np.array([1.6, 2.6]), 400

Sampler = Callable[[jax.Array, int, int], jax.Array]
"""From a key, a number of members and one of iterations to the last positions (N, 2)."""


def starts(rng_key: jax.Array, members: int) -> jax.Array:
    return START + START_SPREAD * jax.random.normal(rng_key, (members, 2))


def sample_demc(settings: DEMCSettings, rng_key: jax.Array, members: int, iterations: int) -> jax.Array:
    key_start, key_run = jax.random.split(rng_key)
    chains = demc_chains(key_run, starts(key_start, members), mueller_log_density, settings._replace(num_updates=iterations))
    return chains.draws[:, -1]


def sample_random_walk(step: float, rng_key: jax.Array, members: int, iterations: int) -> jax.Array:
    """Metropolis with a step of its own in each direction, the best of a few by the result."""
    key_start, key_run = jax.random.split(rng_key)

    def update(x: jax.Array, rng_key: jax.Array) -> tuple[jax.Array, None]:
        key_step, key_accept = jax.random.split(rng_key)
        proposal = x + step * jax.random.normal(key_step, x.shape)
        ratio = mueller_log_density(proposal) - mueller_log_density(x)
        accept = jnp.log(jax.random.uniform(key_accept, ratio.shape)) < ratio
        return jnp.where(accept[:, None], proposal, x), None

    return jax.lax.scan(update, starts(key_start, members), jax.random.split(key_run, iterations))[0]


def sample_hmc(rng_key: jax.Array, members: int, iterations: int) -> jax.Array:
    """Ten leapfrog steps an update; the step size is fixed at what keeps nine in ten."""
    key_start, key_run = jax.random.split(rng_key)
    settings = HMCSettings(max(1, iterations // 10), 10, 0, target_acceptance=None, jitter=0.5)
    return hmc_chains(key_run, starts(key_start, members), mueller_log_density, jnp.log(0.08), settings).draws[:, -1]


def sample_tempered(rng_key: jax.Array, members: int, iterations: int) -> jax.Array:
    """Eight evaluations a temperature, and at most as many temperatures as the evaluations allow."""
    key_start, key_run = jax.random.split(rng_key)
    particles = BROAD_CENTRE + BROAD_SPREAD * jax.random.normal(key_start, (members, 2))

    def log_broad(x: jax.Array, context: None = None) -> jax.Array:
        return -0.5 * jnp.sum(((x - BROAD_CENTRE) / BROAD_SPREAD) ** 2)

    moves = HMC_MOVES._replace(num_moves=2, num_leapfrog=3)
    settings = Tempering(0.5, max(1, iterations // 8), None, 1, True, moves, systematic)
    likelihood = lambda x: mueller_log_density(x) - log_broad(x)  # noqa: E731
    return temper(key_run, particles, None, log_broad, likelihood, jnp.eye(2), jnp.log(0.5), settings).particles


SAMPLERS: dict[str, Sampler] = {
    "DE-MC": partial(sample_demc, DEMCSettings()),
    "DE-MC, a tenth of the steps with lambda = 1": partial(sample_demc, DEMCSettings(jump=0.1)),
    "DE-MC, a third of the steps snooker": partial(sample_demc, DEMCSettings(snooker=0.3)),
    "DE-MC of past states": partial(sample_demc, DEMCSettings(past_states=True)),
    "random-walk Metropolis, step 0.2": partial(sample_random_walk, 0.2),
    "random-walk Metropolis, step 0.5": partial(sample_random_walk, 0.5),
    "HMC": sample_hmc,
    "tempered SMC, from a broad start": sample_tempered,
}


def basin_grid() -> tuple[np.ndarray, np.ndarray]:
    """The potential on a grid, and for each point the basin (an index into MINIMA) that steepest descent ends in."""
    axes = [np.linspace(low, high, POINTS) for low, high in zip(LOW, HIGH, strict=True)]
    potential = np.asarray(mueller_potential(jnp.asarray(np.stack(np.meshgrid(*axes, indexing="ij"), -1))), float)
    index = np.arange(POINTS**2).reshape(POINTS, POINTS)
    padded = np.pad(potential, 1, constant_values=np.inf)
    padded_index = np.pad(index, 1)
    windows = [(slice(i, i + POINTS), slice(j, j + POINTS)) for i in range(3) for j in range(3)]
    lowest = np.argmin([padded[window] for window in windows], 0)
    pointer = np.choose(lowest, [padded_index[window] for window in windows]).ravel()
    for _ in range(20):  # each turn doubles the length of the paths
        pointer = pointer[pointer]
    minima = nearest(np.array(MINIMA)).tolist()
    bottoms = np.unravel_index(pointer, (POINTS, POINTS))
    places = np.stack(np.unravel_index(minima, (POINTS, POINTS)))
    distances = sum((b[:, None] - p[None]) ** 2 for b, p in zip(bottoms, places, strict=True))
    return potential, np.argmin(distances, 1)


def nearest(positions: np.ndarray) -> np.ndarray:
    """Indices (...) of the grid points nearest to positions (..., 2)."""
    steps = np.clip(np.rint((positions - LOW) / (HIGH - LOW) * (POINTS - 1)), 0, POINTS - 1).astype(int)
    return steps[..., 0] * POINTS + steps[..., 1]


def true_shares(potential: np.ndarray, basins: np.ndarray, temperature: float = 15.0) -> np.ndarray:
    """Probability of each basin by quadrature."""
    weights = np.exp(-(potential - potential.min()) / temperature).ravel()
    return np.bincount(basins, weights, 3) / weights.sum()


def sampled_shares(sampler: Sampler, basins: np.ndarray, members: int, iterations: int, runs: int) -> np.ndarray:
    """Shares (runs, 3) of the last positions in each basin."""
    run = jax.jit(lambda keys: jax.lax.map(lambda key: sampler(key, members, iterations), keys))
    positions = np.asarray(run(jax.random.split(jax.random.key(0), runs)), float)
    return np.stack([np.bincount(basins[nearest(row)], minlength=3) / members for row in positions])


def main() -> None:
    options = arguments(__doc__, members=200, iterations=30, runs=20)
    members, runs = (20, 2) if options.quick else (options.members, options.runs)
    potential, basins = basin_grid()
    rows = [["quadrature", *(f"{100 * share:.1f}" for share in true_shares(potential, basins))]]
    for name, sampler in SAMPLERS.items():
        shares = 100 * sampled_shares(sampler, basins, members, options.iterations, runs)
        errors = shares.std(0, ddof=1) / np.sqrt(runs)
        rows.append([name, *(f"{mean:.1f} +- {error:.1f}" for mean, error in zip(shares.mean(0), errors, strict=True))])
    title = f"Share of each basin in %, {members} samples from the second, {options.iterations} iterations"
    show(title, ["", *(f"({x:.2f}, {y:.2f})" for x, y in MINIMA)], rows)


if __name__ == "__main__":
    main()
