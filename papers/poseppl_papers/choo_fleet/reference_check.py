"""Whether the references of section 7.3 are right: their means beside those of another algorithm.

The references are long HMC runs, and HMC is one of the two contestants. A tempered particle filter shares neither its start nor
its weights of modes: it cools particles from the prediction to the posterior. Its runs' mean has a standard error of its own,
so the difference of a coordinate, over both errors, is t-distributed if the reference is right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import numpy as np
from jax import Array
from scipy.stats import t as student

from poseppl.compilation import jit
from poseppl.filters import tempered_filter
from poseppl.program import Observation
from poseppl_papers.choo_fleet.single_frame import reference
from poseppl_papers.choo_fleet.systems import TrackerJob, frame_of
from poseppl_papers.experiment import FAILS, HOLDS, Results, Tables
from poseppl_papers.recordings import Recording
from poseppl_papers.tables import Table

CHANCE = 0.01
"""Probability below which the differences of all frames together are no chance."""
_SEED = 2011


@dataclass(frozen=True)
class ReferenceCheck(TrackerJob):
    """Runs of the tempered filter at one frame, and a reference for the same noise.

    Attributes:
        frame: Index of the frame.
        num_runs: R, number of runs.
        num_particles: N of a run.
        num_chains: Number of chains of the reference.
    """

    frame: int
    num_runs: int
    num_particles: int
    num_chains: int

    @property
    def name(self) -> str:
        """Tracker, recording and frame."""
        return f"reference-{self.system}-{self.recording.name}-{self.frame}"


def check_reference(job: ReferenceCheck) -> dict[str, Any]:
    """Run both.

    Returns:
        ``means`` (R, d) of the tempered filter; ``mean``, ``standard_error`` and ``variance`` (d,) of the reference.
    """
    frame = frame_of(job.recording, job.system, job.frame)
    tempered, long_run = _compiled(job.recording, job.system, job.num_particles, job.num_chains)
    keys = jax.random.split(jax.random.fold_in(jax.random.key(_SEED), job.frame), job.num_runs + 1)
    observation = frame.observe(0)
    found = jax.device_get(long_run(keys[0], observation, frame.inputs))
    means = np.stack([np.asarray(tempered(key, observation, frame.inputs)) for key in keys[1:]])
    rest = {"mean": found.mean, "standard_error": found.standard_error, "variance": np.diagonal(found.covariance)}
    return {"means": means} | rest


@lru_cache(maxsize=16)
def _compiled(recording: Recording, system: str, num_particles: int, num_chains: int) -> tuple[Any, Any]:
    model = frame_of(recording, system, 1).problem.model  # frames differ in their inputs alone
    tempered = tempered_filter(model, num_particles)

    def mean(rng_key: Array, observation: Observation, inputs: Any) -> Array:
        state, _ = tempered.init(rng_key, observation, inputs)
        average: Array = jax.nn.softmax(state.log_weights) @ state.particles
        return average

    return jit(mean), jit(reference(model, num_chains))


def reference_table(jobs: Sequence[ReferenceCheck], results: Results) -> Table:
    """Differences of the reference's means from the tempered filter's, and whether they are chance."""
    columns = ("tracker", "recording", "frame", "runs", "mean_square", "by_chance", "largest", "probability")
    rows = [(job.system, job.recording.name, job.frame, job.num_runs, *compare(**results[job.key])) for job in jobs]
    about = (
        "Differences of the references' means from those of a tempered particle filter: mean square over coordinates, in "
        "posterior variances, and what chance alone gives; the largest, in standard errors; and the probability of one as "
        "large by chance (Student's t, Bonferroni's bound over coordinates)."
    )
    return Table("reference_check", columns, rows, about)


def compare(means: Any, mean: Any, standard_error: Any, variance: Any) -> tuple[float, float, float, float]:
    """Mean square of the differences, what chance gives, the largest in standard errors, and its probability.

    Args:
        means: Means of R runs (R, d).
        mean: The reference's (d,).
        standard_error: Its standard error (d,).
        variance: The posterior's variance (d,).
    """
    number, dimension = np.shape(means)
    off = np.mean(means, 0) - mean
    square_error = np.var(means, 0, ddof=1) / number + np.square(standard_error)
    largest = float(np.abs(off / np.sqrt(square_error)).max())
    probability = min(1.0, 2 * dimension * float(student.sf(largest, number - 1)))
    return float(np.mean(off**2 / variance)), float(np.mean(square_error / variance)), largest, probability


def references_agree(tables: Tables) -> str:
    """A sentence on the differences of all frames, for the page; empty where they were not computed."""
    if "reference_check" not in tables:
        return ""
    rows = tables["reference_check"].records()
    least = min(1.0, len(rows) * min(row["probability"] for row in rows))
    verdict = HOLDS if least > CHANCE else FAILS
    extra = np.mean([row["mean_square"] - row["by_chance"] for row in rows])
    return (
        f"References are long HMC runs, and HMC is a contestant. Their means agree with those of a tempered particle filter "
        f"in {len(rows)} posteriors: {verdict} (the largest difference has the probability {least:.2g} by chance). Beyond "
        f"chance, the mean square difference of a coordinate is {extra:.1g} posterior variances."
    )
