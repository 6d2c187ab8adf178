"""The jobs of section 7.3: estimates of one frame's posterior mean by both filters, and the reference that they are held to."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import numpy as np

from poseppl.compilation import jit
from poseppl_papers.choo_fleet.estimators import ESTIMATES, Estimate, reference
from poseppl_papers.choo_fleet.systems import SYSTEMS, frame_of
from poseppl_papers.choo_fleet.tracker_job import TrackerJob
from poseppl_papers.recordings import Recording
from poseppl_papers.runs import stacked

METHODS = tuple(ESTIMATES)
_COST = {"arm": 0.02, "lower_body": 0.35, "full_body": 1.0}
_SEED = 2001


@dataclass(frozen=True)
class FrameRuns(TrackerJob):
    """Runs of both filters and of the reference at one frame.

    Attributes:
        frame: Index of the frame.
        runs: Numbers of the runs; each has noise of its own.
        num_settings: How many settings of the row of Table 1.
        num_chains: Number of chains of the reference.
    """

    frame: int
    runs: tuple[int, ...]
    num_settings: int
    num_chains: int

    @property
    def name(self) -> str:
        """Tracker, recording, frame and the first run."""
        return f"frame-{self.system}-{self.recording.name}-{self.frame}-{self.runs[0]}"

    @property
    def cost(self) -> float:
        """Relative to a run of the full body at all settings."""
        return len(self.runs) * _COST[self.system] * 2.0 ** (self.num_settings - 7)


def estimate_frame(job: FrameRuns) -> dict[str, Any]:
    """Compute the estimates.

    Returns:
        For each method ``METHOD_means`` (run, setting, d), ``METHOD_ess``, ``METHOD_num_likelihood`` and
        ``METHOD_num_gradient`` (run, setting), ``METHOD_rejection`` (run,); ``reference_mean`` and
        ``reference_standard_error`` (run, d), ``reference_covariance`` (run, d, d) and ``prior_sd`` (d,).
    """
    frame = frame_of(job.recording, job.system, job.frame)
    functions = compiled(job.recording, job.system, job.num_settings, job.num_chains)
    rows: list[dict[str, Any]] = []
    for run in job.runs:
        observation = frame.observe(run)
        row: dict[str, Any] = {}
        for number, (method, function) in enumerate(functions.items()):
            key = jax.random.fold_in(jax.random.key(_SEED), (run * 1000 + job.frame) * 4 + number)
            found = jax.device_get(function(key, observation, frame.inputs))
            row |= {f"{method}_{name}": values for name, values in found._asdict().items()}
        rows.append(row)
    arrays = stacked(rows)
    scale = np.asarray(frame.problem.record()["start_scale"])
    return arrays | {"prior_sd": scale[list(frame.stage.body.free_coordinates)]}


@lru_cache(maxsize=16)
def compiled(recording: Recording, system: str, num_settings: int, num_chains: int) -> dict[str, Estimate]:
    """The methods, ready to run at any frame."""
    model = frame_of(recording, system, 1).problem.model  # frames differ in their inputs alone
    functions = {method: estimates(model, SYSTEMS[system], num_settings) for method, estimates in ESTIMATES.items()}
    return {name: jit(function) for name, function in {**functions, "reference": reference(model, num_chains)}.items()}
