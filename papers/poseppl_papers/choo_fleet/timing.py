"""Cost of the estimates of section 7.3: seconds of each method at each setting, where it yields that setting alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from poseppl.compilation import jit
from poseppl_papers.choo_fleet.estimators import ESTIMATES
from poseppl_papers.choo_fleet.systems import frame_of, single_frames, stage_of
from poseppl_papers.choo_fleet.tracker_job import TrackerJob
from poseppl_papers.clock import timed


@dataclass(frozen=True)
class FrameTiming(TrackerJob):
    """The time of one estimate.

    Attributes:
        method: "particle" or "hmc".
        setting: Which entry of the row of Table 1.
        repeats: How often it is timed.
    """

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
    frame = frame_of(job.recording, job.system, single_frames(stage_of(job.recording, job.system))[1])
    arguments = frame.observe(0), frame.inputs
    function = jit(ESTIMATES[job.method](frame.problem.model, job.row, job.setting + 1))
    seconds = [timed(function, jax.random.key(repeat), *arguments)[1] for repeat in range(job.repeats + 1)]
    return {"seconds": np.array(seconds[1:])}  # the first one compiles
