"""The jobs of the contest's smoother: NUTS on whole trajectories, which sees the future too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.filters import assumed_density_filter
from poseppl.filters.chains import ChainState
from poseppl.motion.tracking.problem import Problem
from poseppl.runs.frame_sequence import frame_sequence
from poseppl.runs.run import run_filter
from poseppl.smoothers import History, collect_history, trajectory_smoother
from poseppl_papers.choo_fleet.sequence import SequenceRuns, Settings, score_runs
from poseppl_papers.choo_fleet.systems import pose_sequence, stage_of
from poseppl_papers.clock import timed
from poseppl_papers.recordings import Recording

_KEPT = ("state_mean", "state_quantile", "markers_mean", "markers_quantile")


@dataclass(frozen=True)
class TrajectoryRuns(SequenceRuns):
    """Runs of the smoother on one sequence, from the history of the default filter; ``settings`` are the smoother's."""

    @property
    def cost(self) -> float:
        """Relative to a second."""
        return 100.0 + len(self.runs) * self.num_frames


def run_trajectory(job: TrajectoryRuns) -> dict[str, Any]:
    """Filter and smooth; what comes back is as that of :func:`~.sequence.run_sequence`, without a log prior."""
    run = _compiled(job.recording, job.system, job.settings, job.num_frames)

    def find(rng_key: Array, problem: Problem, _: Floats) -> tuple[dict[str, Any], float]:
        return timed(run, rng_key, problem)

    return score_runs(job, find)


@lru_cache(maxsize=4)
def _compiled(
    recording: Recording, system: str, settings: Settings, num_frames: int
) -> Callable[[Array, Problem], dict[str, Any]]:
    """Filter and smoother, run once so that they are compiled."""
    stage = stage_of(recording, system)
    frames = slice(1, 1 + num_frames)
    first = pose_sequence(stage, frames, stage.points[frames])
    model = first.model
    tracker = assumed_density_filter(model)
    smoother = trajectory_smoother(model, **dict(settings))
    collect = first.collector(2)

    def smooth(rng_key: Array, history: History, observations: Any, inputs: Any) -> dict[str, Array]:
        smoothed = smoother.smooth(rng_key, history, observations, inputs)
        keys = jax.random.split(rng_key, num_frames)

        def measure(row: Any) -> dict[str, Array]:
            key, draws, weights, observation, inputs = row
            summary = collect(key, ChainState(draws, weights, jnp.zeros(()), jnp.ones((), bool)), None, inputs).summary
            log_likelihood = model.log_observation(summary["state_mean"], observation, inputs)
            return {"log_likelihood": log_likelihood, **{name: summary[name] for name in _KEPT}}

        found: dict[str, Array] = jax.lax.map(measure, (keys, smoothed.particles, smoothed.log_weights, observations, inputs))
        return found | {"num_gradient": jnp.full(num_frames, smoothed.info.num_gradient / num_frames)}

    compiled = jit(smooth)

    def run(rng_key: Array, problem: Problem) -> dict[str, Any]:
        key_filter, key_smooth = jax.random.split(rng_key)
        filtered = run_filter(tracker, key_filter, problem.observations, problem.inputs, collect=collect_history)
        inputs = frame_sequence(problem.observations, problem.inputs, num_frames).stacked_inputs()
        history = History(*jax.tree.map(jnp.asarray, filtered.outputs))
        found = dict(compiled(key_smooth, history, problem.observations, inputs))
        return found | {
            "log_prior": np.full(num_frames, np.nan),
            "num_likelihood": filtered.info.num_likelihood,
            "num_gradient": found["num_gradient"] + filtered.info.num_gradient,
        }

    timed(run, jax.random.key(0), first)
    return run
