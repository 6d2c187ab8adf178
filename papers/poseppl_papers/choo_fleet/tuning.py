"""Section 7.5: how the HMC filter behaves as one of its settings changes, at one frame of the full body; jobs and tables.

The frame is a step of the filter from the true state of the previous frame. The step size is an argument of it, so that one
compilation serves all step sizes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.compilation import jit
from poseppl.diagnostics import inefficiency, split_rhat
from poseppl.diagnostics.inefficiency import autocorrelation
from poseppl.filters import hmc_filter
from poseppl.filters.chains import chain_state
from poseppl.kernels import HMCSettings
from poseppl_papers.choo_fleet.systems import NUM_WARMUP, TrackerJob, frame_of, single_frames, stage_of
from poseppl_papers.experiment import Results
from poseppl_papers.measured import mean_and_error
from poseppl_papers.runs import stacked
from poseppl_papers.tables import Table

STEP_SIZES = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.5)
NUM_LAGS = 40
_SETTLING = 128
"""Updates at the start of a run that R-hat is followed over."""


@dataclass(frozen=True)
class TuningRuns(TrackerJob):
    """Runs at one L.

    Attributes:
        num_leapfrog: L.
        step_sizes: Each epsilon.
        num_updates: R.
        num_runs: How many runs at each epsilon.
    """

    num_leapfrog: int
    step_sizes: tuple[float, ...]
    num_updates: int
    num_runs: int

    @property
    def name(self) -> str:
        """Tracker and L."""
        return f"tuning-{self.system}-{self.num_leapfrog}"

    @property
    def cost(self) -> float:
        """Relative to a run of the full body at all settings."""
        return 2.0 + len(self.step_sizes) * self.num_runs * self.num_updates * self.num_leapfrog / (512 * 40)


def tune(job: TuningRuns) -> dict[str, Any]:
    """Run the chains.

    Returns:
        For each step size and run: ``rejection`` (step size, run); ``tau`` (step size, run, d), the inefficiency factor of each
        coordinate after the warm-up; ``autocorrelation`` (step size, lag), the mean over coordinates and runs; ``rhat``
        (step size, update), the largest over coordinates of the chains' R-hat over the 16 updates that end there, the median
        over runs; ``num_gradient`` (step size,) a run.
    """
    row, stage = job.row, stage_of(job.recording, job.system)
    frame = frame_of(job.recording, job.system, single_frames(stage)[0])
    settings = HMCSettings(job.num_updates, job.num_leapfrog, 0, row.step_size, None)
    built = hmc_filter(frame.problem.model, row.num_chains, settings)
    before = jnp.asarray(stage.states[frame.number - 1][list(stage.body.free_coordinates)], float)
    particles = jnp.broadcast_to(before, (row.num_chains, 1, row.dimension))

    @jit
    def run(rng_key: Array, step_size: Array, observation: Any, inputs: Any) -> Any:
        state, info = built.step(rng_key, chain_state(particles, jnp.log(step_size)), observation, inputs)
        return state.particles, 1 - info.acceptance, info.num_gradient

    rows = []
    for step_size in job.step_sizes:
        found = [
            jax.device_get(run(jax.random.key(number), jnp.asarray(step_size), frame.observe(number), frame.inputs))
            for number in range(job.num_runs)
        ]
        rows.append(_describe([draws for draws, _, _ in found]) | {"rejection": np.array([each for _, each, _ in found])})
        rows[-1]["num_gradient"] = np.asarray(found[0][2])
    return stacked(rows)


def _describe(runs: list[Any]) -> dict[str, Any]:
    """Mixing of runs (chain, update, d) each."""
    kept = [draws[:, NUM_WARMUP:] for draws in runs]
    lags = min(NUM_LAGS, kept[0].shape[1] - 1)
    stuck = 1.0  # the correlation of a coordinate that never moves
    correlations = [np.nan_to_num(autocorrelation(draws, lags), nan=stuck).mean(1) for draws in kept]
    windows = range(16, min(runs[0].shape[1], _SETTLING) + 1)
    rhats = [[float(np.max(split_rhat(draws[:, end - 16 : end]))) for end in windows] for draws in runs]
    return {
        "tau": np.stack([inefficiency(draws) for draws in kept]),
        "autocorrelation": np.mean(correlations, axis=0),
        "rhat": np.median(rhats, axis=0),
    }


def tuning_tables(jobs: Sequence[TuningRuns], results: Results) -> list[Table]:
    """Rejection and inefficiency by epsilon and L, autocorrelation by lag, R-hat by update."""
    ordered = sorted(jobs, key=lambda job: job.num_leapfrog)
    mixing, correlation, burn_in = [], [], []
    for job in ordered:
        found = results[job.key]
        for index, step_size in enumerate(job.step_sizes):
            rejection = np.asarray(found["rejection"][index], float)
            tau, error = mean_and_error(np.log(found["tau"][index]).mean(-1))
            cost = float(np.exp(tau)), job.num_leapfrog * float(np.exp(tau)), error
            mixing.append((job.num_leapfrog, step_size, *mean_and_error(rejection), *cost))
            for lag, value in enumerate(found["autocorrelation"][index]):
                correlation.append((job.num_leapfrog, step_size, lag, float(value)))
            for offset, value in enumerate(found["rhat"][index]):
                burn_in.append((job.num_leapfrog, step_size, offset, float(value)))
    return [
        Table(
            "tuning",
            (
                "leapfrog",
                "step_size",
                "rejection",
                "rejection_standard_error",
                "tau",
                "gradients_per_draw",
                "log_standard_error",
            ),
            mixing,
            "Rejection rate, inefficiency factor (geometric mean over coordinates and runs), gradients an independent draw, "
            "and the standard error of the natural logarithm of both. They are nan where the chains of a run never moved.",
        ),
        Table(
            "autocorrelation",
            ("leapfrog", "step_size", "lag", "autocorrelation"),
            correlation,
            "Mean over coordinates and runs.",
        ),
        Table(
            "burn_in",
            ("leapfrog", "step_size", "burn_in", "rhat"),
            burn_in,
            "Largest R-hat over coordinates of the 16 updates after a burn-in, the median over runs.",
        ),
    ]


def choose(tables: Sequence[Table]) -> dict[str, Any]:
    """The automatic choice: the fewest gradients an independent draw, and the burn-in from which R-hat stays below 1.2.

    Settings whose rejection rate exceeds 30 % are left out: they mix by luck.
    """
    mixing, _, burn_in = tables
    rows = [row for row in mixing.rows if row[2] <= 0.3 and np.isfinite(row[5])]
    if not rows:
        return {}
    best = min(rows, key=lambda row: row[5])
    rhat = burn_in.column("rhat", leapfrog=best[0], step_size=best[1])
    above = np.flatnonzero(rhat > 1.2)
    settled = int(above[-1]) + 1 if len(above) else 0
    return {
        "leapfrog": best[0],
        "step_size": best[1],
        "rejection": best[2],
        "burn_in": settled,
        "is_settled": settled < len(rhat),
    }
