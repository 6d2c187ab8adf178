"""Does smoothing pay when the state has more dimensions? Section 7.1 and Fig. 14: the growth model, T = 100, with exact means.

Each run draws its own truth and data; an error is the root mean square distance of the estimated means from the truth, over
frames and coordinates. The paper made one run for each number of particles; here are many, with standard errors, and the ratio
of smoothed to filtered error is that of the means over the runs. Beside the filter and forward-backward smoothing stand other
particle smoothers, and the exact means from quadrature, below whose error nothing can fall.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.filters import particle_filter
from poseppl.filters.scan import scan_filter
from poseppl.jobs import Job
from poseppl.motion.bodies.body import load_builder
from poseppl.program import CompiledModel, Observation
from poseppl.smoothers import (
    History,
    Smoothed,
    Smoother,
    backward_simulation_smoother,
    collect_history,
    forward_backward_smoother,
    two_filter_smoother,
)
from poseppl_papers.experiment import Results
from poseppl_papers.measured import mean_and_error
from poseppl_papers.tables import Table

EXACT, FILTER, FBS = "exact", "filter", "FBS"


class GrowthSmoother(NamedTuple):
    """A smoother: its builder, from the model and a number of particles, and whether its time grows with their square."""

    build: Callable[[CompiledModel, int], Smoother]
    is_quadratic: bool


SMOOTHERS: Mapping[str, GrowthSmoother] = {
    FBS: GrowthSmoother(lambda model, number: forward_backward_smoother(model), True),
    "backward simulation, 5 moves": GrowthSmoother(
        lambda model, number: backward_simulation_smoother(model, number, method="metropolis", num_moves=5), False
    ),
    "two-filter, 4 pairs": GrowthSmoother(lambda model, number: two_filter_smoother(model, method="linear"), False),
    "two-filter, exact": GrowthSmoother(lambda model, number: two_filter_smoother(model), True),
}


@dataclass(frozen=True)
class GrowthRuns(Job):
    """Runs of one smoother on data sets of the growth model.

    Attributes:
        dimension: Dimension of the state.
        smoother: Its name, or :data:`EXACT`.
        num_particles: Number of particles of the filter; 0 for the exact means.
        num_runs: How many data sets.
        num_frames: Number of frames of each.
    """

    dimension: int
    smoother: str
    num_particles: int
    num_runs: int
    num_frames: int = 100

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"growth-{self.dimension}-{self.smoother}-{self.num_particles}"

    @property
    def cost(self) -> float:
        """Relative to a second."""
        number = self.num_particles
        steps = number**2 if self.smoother in SMOOTHERS and SMOOTHERS[self.smoother].is_quadratic else 100.0 * number
        return 10.0 + 5e-8 * self.num_runs * self.dimension * steps


def smooth_growth(job: GrowthRuns) -> dict[str, Any]:
    """Run the smoother.

    Returns:
        ``filtered`` and ``smoothed``: errors of both (run,).
    """
    sets = _sets(job.num_runs, job.num_frames, job.dimension)
    if job.smoother == EXACT:
        return {name: errors(means, sets.truth) for name, means in zip(("filtered", "smoothed"), sets.exact(), strict=True)}
    run = run_of(sets, job.num_particles, SMOOTHERS[job.smoother].build)
    pairs = []
    for index in range(job.num_runs):
        observations = jax.tree.map(lambda leaf, index=index: leaf[index], sets.observations)
        pairs.append(run(jax.random.key(index), observations))
    return {
        name: errors(np.array(means), sets.truth)
        for name, means in zip(("filtered", "smoothed"), zip(*pairs, strict=True), strict=True)
    }


@lru_cache(maxsize=2)
def _sets(num_runs: int, num_frames: int, dimension: int) -> Growth:
    return growth_sets(num_runs, num_frames, dimension=dimension, seed=dimension)


def errors(means: Floats, truth: Floats) -> Floats:
    """Root mean square (R,) over frames and coordinates of means (R, T, d) from the truth."""
    return np.asarray(np.sqrt(np.mean((means - truth) ** 2, axis=(1, 2))))


def dimensionality_tables(jobs: Sequence[GrowthRuns], results: Results) -> list[Table]:
    """Errors of all smoothers, and the share of the filter's error that forward-backward smoothing leaves."""
    rows: list[tuple[Any, ...]] = []
    for job in jobs:
        filtered, smoothed = (np.asarray(results[job.key][name]) for name in ("filtered", "smoothed"))
        size = EXACT if job.smoother == EXACT else job.num_particles
        if job.smoother in (EXACT, FBS):
            rows.append((job.dimension, size, FILTER, job.num_runs, *mean_and_error(filtered), 1.0, 0.0))
        rows.append((job.dimension, size, job.smoother, job.num_runs, *mean_and_error(smoothed), *_share(smoothed, filtered)))
    columns = ("dimension", "particles", "method", "runs", "error", "standard_error", "share", "share_standard_error")
    about = "Root mean square error of estimated means on Godsill's model, T = 100, and its share of the filter's."
    named = [row for row in rows if row[2] in (EXACT, FBS)]
    shares = [(*row[:2], row[3], row[6], np.nan if row[2] == EXACT else row[7]) for row in named]
    return [
        Table("dimensionality", (*columns[:2], columns[3], *columns[6:]), shares, SHARES_ABOUT),
        Table("smoothers", columns, rows, about),
    ]


SHARES_ABOUT = "Error of forward-backward smoothing as a share of the filter's."


def _share(smoothed: Floats, filtered: Floats) -> tuple[float, float]:
    """Ratio of the means, and its standard error (delta method)."""
    ratio = smoothed.mean() / filtered.mean()
    spread = (smoothed - ratio * filtered).std(ddof=1) / filtered.mean() / len(filtered) ** 0.5
    return float(ratio), float(spread)


VARIANCE = 10.0
"""Variance of the transition and of the first state."""

GRID = np.linspace(-45.0, 45.0, 1501)


class Growth(NamedTuple):
    """Data sets of d coordinates, each on its own.

    Attributes:
        model: The compiled model.
        times: Its inputs (T,).
        truth: States (S, T, d).
        observations: Stacked data (S, T, ...).
        values: The data as numbers (S, T, d).
    """

    model: CompiledModel
    times: Array
    truth: Floats
    observations: Observation
    values: Floats

    def exact(self) -> tuple[Floats, Floats]:
        """Exact filtered and smoothed means (S, T, d), from a grid, coordinate by coordinate."""
        sets, frames, dimension = self.values.shape
        series = self.values.transpose(0, 2, 1).reshape(-1, frames)
        filtered, smoothed = (means.reshape(sets, dimension, frames).transpose(0, 2, 1) for means in exact_means(series))
        return filtered, smoothed


def growth_sets(num_sets: int, num_frames: int = 100, dimension: int = 1, seed: int = 0) -> Growth:
    """Draw data sets."""
    rng = np.random.default_rng(seed)
    shape = (num_sets, dimension)
    xs = [rng.normal(size=shape) * VARIANCE**0.5]
    for t in range(2, num_frames + 1):
        xs.append(step_mean(xs[-1], t) + VARIANCE**0.5 * rng.normal(size=shape))
    truth = np.stack(xs, 1)
    ys = truth**2 / 20 + rng.normal(size=truth.shape)
    build: Any = load_builder("poseppl_models.toys.growth:growth")
    model = build(dimension).compile(1.0)
    sets = [model.observe({"y": y[:, 0] if dimension == 1 else y}) for y in ys]
    observations = jax.tree.map(lambda *leaves: jnp.stack(leaves), *sets)
    return Growth(model, jnp.arange(1.0, num_frames + 1), truth, observations, ys)


def step_mean(x: Any, time: int) -> Any:
    """Mean of x_t given x_(t-1)."""
    return x / 2 + 25 * x / (1 + x * x) + 8 * np.cos(1.2 * time)


def exact_means(ys: Floats) -> tuple[Floats, Floats]:
    """Filtered and smoothed means (S, T) of scalar series ys (S, T), all at once on the grid."""
    num_frames = ys.shape[1]

    def likelihood(t: int) -> Floats:
        return np.exp(-0.5 * (ys[:, t, None] - GRID**2 / 20) ** 2)

    def kernel(t: int) -> Floats:
        values: Floats = np.exp(-0.5 / VARIANCE * (GRID - step_mean(GRID, t + 1)[:, None]) ** 2)
        return values

    forward: list[Floats] = []
    for t in range(num_frames):
        predicted = np.exp(-0.5 / VARIANCE * GRID**2) if t == 0 else forward[-1] @ kernel(t)
        joint = predicted * likelihood(t)
        forward.append(joint / joint.sum(1, keepdims=True))
    backward, means = np.ones_like(forward[0]), [forward[-1] @ GRID]
    for t in range(num_frames - 1, 0, -1):
        backward = (backward * likelihood(t)) @ kernel(t).T
        backward /= backward.max(1, keepdims=True)
        product = forward[t - 1] * backward
        means.append(product @ GRID / product.sum(1))
    return np.stack([p @ GRID for p in forward], 1), np.stack(means[::-1], 1)


def filter_history(
    model: CompiledModel, num_particles: int, rng_key: Array, observations: Observation, times: Array
) -> History:
    """The history of a bootstrap filter over all frames."""
    tracker = particle_filter(model, num_particles)
    history: History = scan_filter(tracker, rng_key, observations, times, collect=collect_history).outputs
    return history


def means_of(result: History | Smoothed) -> Array:
    """Weighted means (T, d)."""
    barrier: Any = jax.lax.optimization_barrier  # or constants are folded at length
    weights = jax.nn.softmax(barrier(result.log_weights), 1)
    return jnp.einsum("tn,tnd->td", weights, result.particles)


Run = Callable[[Array, Observation], tuple[Array, Array]]


def run_of(posed: Growth, num_particles: int, build: Callable[[CompiledModel, int], Smoother] | None) -> Run:
    """`(rng_key, observations) -> filtered and smoothed means (T, d)`, jitted; without a smoother the filter's twice."""
    smoother = None if build is None else build(posed.model, num_particles)

    @jit
    def run(rng_key: Array, observations: Observation) -> tuple[Array, Array]:
        key_filter, key_smooth = jax.random.split(rng_key)
        history = filter_history(posed.model, num_particles, key_filter, observations, posed.times)
        filtered = means_of(history)
        if smoother is None:
            return filtered, filtered
        return filtered, means_of(smoother.smooth(key_smooth, history, observations, posed.times))

    return run
