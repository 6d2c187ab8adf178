"""Cost of the estimates of section 7.3: seconds of each method at each setting, where it yields that setting alone.

Methods and settings take turns, so that whatever slows the machine for a while slows all of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import jax
import numpy as np

from poseppl.compilation import jit
from poseppl_papers.choo_fleet.estimators import ESTIMATES
from poseppl_papers.choo_fleet.systems import frame_of, single_frames, stage_of
from poseppl_papers.choo_fleet.tracker_job import TrackerJob
from poseppl_papers.clock import timed


@dataclass(frozen=True)
class FrameTiming(TrackerJob):
    """The times of all estimates of a tracker.

    Attributes:
        num_settings: How many settings of the row of Table 1.
        repeats: How often each is timed.
    """

    version: ClassVar[int] = 2
    num_settings: int
    repeats: int

    @property
    def name(self) -> str:
        """The tracker."""
        return f"timing-{self.system}"

    @property
    def cost(self) -> float:
        """Relative to a run of the full body at all settings."""
        return 4.0 * self.num_settings + self.repeats * 2.0 ** (self.num_settings - 6)


def time_frame(job: FrameTiming) -> dict[str, Any]:
    """Time the estimates, one after the other in each round.

    Returns:
        For each method ``METHOD_seconds`` (repeat, setting), without compilation.
    """
    frame = frame_of(job.recording, job.system, single_frames(stage_of(job.recording, job.system))[1])
    arguments = frame.observe(0), frame.inputs
    functions = {
        (method, setting): jit(estimate(frame.problem.model, job.row, setting + 1))
        for method, estimate in ESTIMATES.items()
        for setting in range(job.num_settings)
    }
    rounds = [
        {name: timed(function, jax.random.key(repeat), *arguments)[1] for name, function in functions.items()}
        for repeat in range(job.repeats + 1)
    ]
    return {
        f"{method}_seconds": np.array([[each[method, setting] for setting in range(job.num_settings)] for each in rounds[1:]])
        for method in ESTIMATES
    }  # the first round compiles
