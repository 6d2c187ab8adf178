"""Cost of the estimates of section 7.3: seconds of each method at each setting, where it yields that setting alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from poseppl.experiments.choo_fleet.clock import timed
from poseppl.experiments.choo_fleet.estimators import Estimate, hmc_estimates, particle_estimates
from poseppl.experiments.choo_fleet.single_frame import model_of
from poseppl.experiments.choo_fleet.systems import SYSTEMS, UPDATES, Recording, frame_problem, observe, single_frames, stage_of
from poseppl.experiments.jobs import Job
from poseppl.program import CompiledModel
from poseppl.runs.frame_sequence import frame_inputs


@dataclass(frozen=True)
class FrameTiming(Job):
    """The time of one estimate.

    Attributes:
        recording: Who is seen.
        system: The tracker.
        method: "particle" or "hmc".
        setting: Which entry of the row of Table 1.
        repeats: How often it is timed.
    """

    recording: Recording
    system: str
    method: str
    setting: int
    repeats: int

    @property
    def name(self) -> str:
        """Tracker, method and setting."""
        return f"timing-{self.system}-{self.method}-{self.setting}"

    @property
    def cost(self) -> float:
        """Relative to a run of the full body at all settings."""
        return 2.0 + self.repeats * 2.0 ** (self.setting - 7)


def time_frame(job: FrameTiming) -> dict[str, Any]:
    """Time the estimate.

    Returns:
        ``seconds`` (repeat,), without compilation.
    """
    row = SYSTEMS[job.system]
    stage = stage_of(job.recording, row)
    frame = single_frames(stage)[1]
    problem = frame_problem(stage, frame)
    arguments = observe(problem, stage, frame, 0), frame_inputs(problem.inputs, 0)
    function = jax.jit(_estimate(model_of(job.recording, job.system), job))
    seconds = [timed(function, jax.random.key(repeat), *arguments)[1] for repeat in range(job.repeats + 1)]
    return {"seconds": np.array(seconds[1:])}  # the first one compiles


def _estimate(model: CompiledModel, job: FrameTiming) -> Estimate:
    if job.method == "particle":
        return particle_estimates(model, SYSTEMS[job.system], job.setting + 1)
    return hmc_estimates(model, SYSTEMS[job.system], UPDATES[: job.setting + 1])
