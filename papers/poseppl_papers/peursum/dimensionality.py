"""Does smoothing pay when the state has more dimensions? Section 7.1 and Fig. 14: the growth model, T = 100.

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
import numpy as np

from poseppl.arrays import Floats
from poseppl.jobs import Job
from poseppl.program import CompiledModel
from poseppl.smoothers import Smoother, backward_simulation_smoother, forward_backward_smoother, two_filter_smoother
from poseppl_papers.experiment import Results
from poseppl_papers.measured import mean_and_error
from poseppl_papers.peursum.growth_sets import Growth, growth_sets, run_of
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
