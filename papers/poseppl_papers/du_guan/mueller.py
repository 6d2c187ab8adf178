"""Who finds the basins of Mueller's surface from one of them, at an equal number of evaluations? Section 2.2, Fig. 2b.

200 samples that start in the second deepest basin make 30 iterations, 6,000 evaluations of the density (a gradient counts as
one). The share of the samples in each basin, after the last iteration, is the mean over runs; quadrature on a grid gives the
true shares. A sampler that starts from one basin has to cross barriers; tempered SMC starts from a broad normal distribution
instead, with as many particles. The standard dynamics that the paper cites, Langevin's, makes 200 times as many steps, 6,000.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib import import_module
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.filters.tempering import Tempering, temper
from poseppl.jobs import Job
from poseppl.kernels import HMC_MOVES, DEMCSettings, HMCSettings, demc_chains, hmc_chains
from poseppl.particles.resampling import systematic
from poseppl_papers.experiment import Jobs, Results
from poseppl_papers.measured import mean_interval
from poseppl_papers.tables import Table, grouped

SURFACE = "poseppl_models.toys.mueller"
START_SPREAD = 0.05
BROAD_CENTRE, BROAD_SPREAD = (0.0, 0.75), 0.75
EXACT, DEMC, TEMPERED = "quadrature", "DE-MC", "tempered SMC, from a broad normal"
LONGER = 200
"""Steps of the standard dynamics for each iteration of the others."""
DYNAMICS = "Langevin dynamics, 200 steps an iteration"
BASINS = ("a", "b", "c")
LogDensity = Callable[[Array], Array]
Sampler = Callable[[LogDensity, Array, int, int], Array]
"""From a log-density, a key, a number of members and one of iterations to the last positions (N, 2)."""


def starts(rng_key: Array, members: int) -> Array:
    """Positions (N, 2) in the second deepest basin."""
    centre = jnp.array(import_module(SURFACE).MINIMA[1])
    return centre + START_SPREAD * jax.random.normal(rng_key, (members, 2))


def _demc(settings: DEMCSettings, log_density: LogDensity, rng_key: Array, members: int, iterations: int) -> Array:
    key_start, key_run = jax.random.split(rng_key)
    chains = demc_chains(key_run, starts(key_start, members), log_density, settings._replace(num_updates=iterations))
    return chains.draws[:, -1]


def _random_walk(step: float, log_density: LogDensity, rng_key: Array, members: int, iterations: int) -> Array:
    key_start, key_run = jax.random.split(rng_key)

    def update(x: Array, rng_key: Array) -> tuple[Array, None]:
        key_step, key_accept = jax.random.split(rng_key)
        proposal = x + step * jax.random.normal(key_step, x.shape)
        ratio = log_density(proposal) - log_density(x)
        accept = jnp.log(jax.random.uniform(key_accept, ratio.shape)) < ratio
        return jnp.where(accept[:, None], proposal, x), None

    return jax.lax.scan(update, starts(key_start, members), jax.random.split(key_run, iterations))[0]


def _hmc(
    settings: Callable[[int], HMCSettings], log_density: LogDensity, rng_key: Array, members: int, iterations: int
) -> Array:
    """The step size is fixed at what keeps nine in ten updates of ten steps at temperature 15."""
    key_start, key_run = jax.random.split(rng_key)
    return hmc_chains(key_run, starts(key_start, members), log_density, jnp.log(0.08), settings(iterations)).draws[:, -1]


def _ten_steps(iterations: int) -> HMCSettings:
    """Ten leapfrog steps an update."""
    return HMCSettings(max(1, iterations // 10), 10, 0, target_acceptance=None, jitter=0.5)


def _one_step(iterations: int) -> HMCSettings:
    """One leapfrog step an update, accepted or not: Langevin's dynamics."""
    return HMCSettings(LONGER * iterations, 1, 0, target_acceptance=None)


def _tempered(log_density: LogDensity, rng_key: Array, members: int, iterations: int) -> Array:
    """Eight evaluations a temperature, and at most as many temperatures as the evaluations allow."""
    key_start, key_run = jax.random.split(rng_key)
    centre = jnp.array(BROAD_CENTRE)
    particles = centre + BROAD_SPREAD * jax.random.normal(key_start, (members, 2))

    def log_broad(x: Array, context: None = None) -> Array:
        return -0.5 * jnp.sum(((x - centre) / BROAD_SPREAD) ** 2)

    def log_rest(x: Array) -> Array:
        return log_density(x) - log_broad(x)

    moves = HMC_MOVES._replace(num_moves=2, num_leapfrog=3)
    settings = Tempering(0.5, max(1, iterations // 8), None, 1, True, moves, systematic)
    return temper(key_run, particles, None, log_broad, log_rest, jnp.eye(2), jnp.log(0.5), settings).particles


SAMPLERS: Mapping[str, Sampler] = {
    DEMC: partial(_demc, DEMCSettings()),
    "DE-MC with jumps, a tenth of the steps with lambda = 1": partial(_demc, DEMCSettings(jump=0.1)),
    "DE-MC with snooker moves": partial(_demc, DEMCSettings(snooker=0.3)),
    "DE-MC with past states": partial(_demc, DEMCSettings(past_states=True)),
    "random walk, step 0.2": partial(_random_walk, 0.2),
    "random walk, step 0.5": partial(_random_walk, 0.5),
    "HMC": partial(_hmc, _ten_steps),
    DYNAMICS: partial(_hmc, _one_step),
    TEMPERED: _tempered,
}


@dataclass(frozen=True)
class MuellerRuns(Job):
    """Runs of one sampler.

    Attributes:
        sampler: Its name in :data:`SAMPLERS`.
        temperature: Temperature of the density.
        members: How many samples.
        iterations: Evaluations of each.
        num_runs: How many runs.
    """

    sampler: str
    temperature: float
    members: int
    iterations: int
    num_runs: int

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"mueller-{self.sampler}-{self.temperature:g}"


def sample_mueller(job: MuellerRuns) -> dict[str, Any]:
    """Run the sampler.

    Returns:
        ``shares`` (run, basin) of the last positions in each basin.
    """
    log_density = partial(import_module(SURFACE).mueller_log_density, temperature=job.temperature)
    sampler = SAMPLERS[job.sampler]
    run = jit(lambda keys: jax.lax.map(lambda key: sampler(log_density, key, job.members, job.iterations), keys))
    positions = np.asarray(run(jax.random.split(jax.random.key(0), job.num_runs)), np.float64)
    return {"shares": np.stack([basin_shares(SURFACE, row) for row in positions])}


def mueller_table(jobs: Jobs, results: Results) -> list[Table]:
    """One row a sampler and temperature, after the true shares at each, with half of the 95 % interval of a mean over runs."""
    rows: list[tuple[Any, ...]] = []
    for temperature, own in grouped(jobs["surface"], lambda job: float(job.temperature)).items():
        exact = [100 * share for share in true_shares(SURFACE, temperature).tolist()]
        rows.append((temperature, EXACT, *exact, *(0.0 for _ in BASINS), 0))
        for job in own:
            intervals = [mean_interval(100 * each) for each in results[job.key]["shares"].T]
            means, reaches = [each.mean for each in intervals], [each.high - each.mean for each in intervals]
            rows.append((temperature, job.sampler, *means, *reaches, job.num_runs))
    size = f"{job.members} samples in the basins A, B and C after {job.iterations} iterations"
    columns = ("temperature", "method", *BASINS, *(f"{name}_reach" for name in BASINS), "runs")
    about = f"Share of {size}, %, mean of runs and half of its 95 % interval by Student's t."
    return [Table("mueller", columns, rows, about)]


LOW, HIGH, POINTS = np.array([-2.0, -0.8]), np.array([1.6, 2.6]), 400


@lru_cache(maxsize=1)
def _basin_grid(surface: str) -> tuple[Floats, NDArray[np.int_]]:
    """The potential on a grid, and for each point the basin (an index into MINIMA) that steepest descent ends in."""
    module = import_module(surface)
    axes = [np.linspace(low, high, POINTS) for low, high in zip(LOW, HIGH, strict=True)]
    potential = np.asarray(module.mueller_potential(jnp.asarray(np.stack(np.meshgrid(*axes, indexing="ij"), -1))), np.float64)
    padded = np.pad(potential, 1, constant_values=np.inf)
    padded_index = np.pad(np.arange(POINTS**2).reshape(POINTS, POINTS), 1)
    windows = [(slice(i, i + POINTS), slice(j, j + POINTS)) for i in range(3) for j in range(3)]
    lowest = np.argmin([padded[window] for window in windows], 0)
    pointer = np.choose(lowest, [padded_index[window] for window in windows]).ravel()
    for _ in range(20):  # each turn doubles the length of the paths
        pointer = pointer[pointer]
    bottoms = np.stack(np.unravel_index(pointer, (POINTS, POINTS)))
    minima = np.stack(np.unravel_index(_nearest(np.array(module.MINIMA)), (POINTS, POINTS)))
    return potential, np.argmin(np.sum((bottoms[:, :, None] - minima[:, None]) ** 2, 0), 1)


def _nearest(positions: Floats) -> NDArray[np.int_]:
    """Indices (...) of the grid points nearest to positions (..., 2)."""
    steps = np.clip(np.rint((positions - LOW) / (HIGH - LOW) * (POINTS - 1)), 0, POINTS - 1).astype(int)
    nearest: NDArray[np.int_] = steps[..., 0] * POINTS + steps[..., 1]
    return nearest


def true_shares(surface: str, temperature: float) -> Floats:
    """Probability of each basin of a module's surface, by quadrature."""
    potential, basins = _basin_grid(surface)
    weights = np.exp(-(potential - potential.min()) / temperature).ravel()
    return np.asarray(np.bincount(basins, weights) / weights.sum())


def basin_shares(surface: str, positions: Floats) -> Floats:
    """Share of positions (N, 2) in each basin of a module's surface."""
    _, basins = _basin_grid(surface)
    return np.asarray(np.bincount(basins[_nearest(positions)], minlength=basins.max() + 1) / len(positions))
