"""The jobs: scores of known poses, and what annealed filters find in the first frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from poseppl.compilation import jit
from poseppl.jobs import Job
from poseppl.motion.bodies.body import load_builder
from poseppl.program import Observation
from poseppl.runs.algorithms import FILTERS
from poseppl_papers.experiment import Jobs, Results
from poseppl_papers.images.systems import LIMBS, Method
from poseppl_papers.measured import over_runs
from poseppl_papers.recordings import Recording
from poseppl_papers.tables import Table

BUILDER = "poseppl_models.bodytrack.files:bodytrack_system"
_NOTHING = Observation({}, {})


@dataclass(frozen=True)
class PoseScores(Job):
    """Scores of the known poses, and of poses about the first one, from every sample and from few.

    Attributes:
        recording: The benchmark's folder.
        num_poses: How many poses, spread as the benchmark spreads its first particles.
    """

    recording: Recording
    num_poses: int


@dataclass(frozen=True)
class FrameEstimates(Job):
    """Runs of one filter on the first frame.

    Attributes:
        recording: The benchmark's folder.
        method: The filter.
        runs: Numbers of the runs, which are seeds.
    """

    recording: Recording
    method: Method
    runs: tuple[int, ...]

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"bodytrack-{self.method.name}"


@lru_cache(maxsize=1)
def _system(recording: Recording) -> Any:
    return load_builder(BUILDER)(recording.path)


def score_poses(job: PoseScores) -> dict[str, Any]:
    """Score the poses.

    Returns:
        The scores of each known pose by its name, and ``every`` and ``few`` (pose,).
    """
    system = _system(job.recording)
    every, few = (jit(jax.vmap(system.scores[name])) for name in ("every", "few"))
    noise = np.random.default_rng(0).normal(size=(job.num_poses, len(system.step_scale)))
    states = jnp.asarray(system.poses["initial"] + system.step_scale * noise, float)
    known = {name: every(jnp.asarray(pose, float)[None])[0] for name, pose in system.poses.items()}
    return known | {"every": every(states), "few": few(states)}


def estimate_frame(job: FrameEstimates) -> dict[str, Any]:
    """Run the filter.

    Returns:
        ``mean`` and ``best`` (run,): scores, from every sample, of the weighted mean and of the best particle;
        ``evaluations`` of the likelihood (run,).
    """
    system = _system(job.recording)
    model = system.program.compile(params=system.params, inputs=system.inputs)
    settings = {name: system.limbs if value == LIMBS else value for name, value in job.method.settings}
    init: Any = jit(FILTERS[job.method.filter].builder(model, **settings).init)
    score = jit(jax.vmap(system.scores["every"]))
    rows = []
    for run in job.runs:
        state, info = init(jax.random.key(run), _NOTHING, system.inputs)
        mean = jnp.exp(state.log_weights) @ state.particles
        rows.append((*np.asarray(score(jnp.stack([mean, state.best])), np.float64), int(info.num_likelihood)))
    return dict(zip(("mean", "best", "evaluations"), np.array(rows).T, strict=True))


def pose_table(jobs: Jobs, results: Results) -> list[Table]:
    """Scores of the known poses, and how few samples stand for all."""
    job = jobs["poses"][0]
    found = {name: np.asarray(values, np.float64) for name, values in results[job.key].items()}
    every, few = found.pop("every"), found.pop("few")
    rows = [(f"score of the {name} pose", float(value)) for name, value in found.items()]
    rows += [
        ("few samples: mean error", float(np.mean(few - every))),
        ("few samples: rms error", float(np.sqrt(np.mean((few - every) ** 2)))),
        ("few samples: correlation", float(np.corrcoef(few, every)[0, 1])),
        ("standard deviation of the scores", float(every.std())),
    ]
    about = f"Scores from every sample; errors of few samples over {job.num_poses} poses spread as the first particles are."
    return [Table("poses", ("figure", "value"), rows, about)]


def estimate_table(jobs: Jobs, results: Results) -> list[Table]:
    """One row a filter."""
    rows = []
    for job in jobs["estimates"]:
        found = results[job.key]
        mean, best = (over_runs(found[name].tolist()) for name in ("mean", "best"))
        rows.append((job.method.name, int(found["evaluations"][0]), mean.runs, *mean[:2], *best[:2]))
    columns = ("method", "evaluations", "runs", "mean", "mean_sd", "best", "best_sd")
    about = "Scores, from every sample, of the weighted mean and of the best particle; means and standard deviations over runs."
    return [Table("estimates", columns, rows, about)]
