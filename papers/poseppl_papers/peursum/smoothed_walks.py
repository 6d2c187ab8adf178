"""The paper's twelve algorithms (Table 1) on walks: three filters, each alone and with three smoothers.

A run is a filter's particles over a walk, and four estimates of them: the filter's, FBS (section 4.2), the variational and the
Gibbs smoother on the mixture of section 4.3. Generic motions are in bins for the last two: one phase, whose rotations diffuse.
Errors are those of the mean posture (:mod:`poseppl_papers.peursum.tracks`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.jobs import Job
from poseppl.jobs.job import later_field
from poseppl.motion.learned import FactoredTables, read_factored_motion, root_places
from poseppl.motion.learned.factored_tables import NUM_BINS
from poseppl_papers.images.scenes import Scene
from poseppl_papers.images.systems import Method, Problem, System, problem_of
from poseppl_papers.images.tracking import compiled_step
from poseppl_papers.peursum.factored_draws import Draw, RootWalk, gibbs, log_transition_matrix, log_walk_matrix, reweigh
from poseppl_papers.peursum.factored_evidence import (
    FactoredPosterior,
    LogTables,
    Mixtures,
    diffusion_tables,
    fit_mixtures,
    log_tables,
)
from poseppl_papers.peursum.factored_mean_field import mean_field, start_marginals
from poseppl_papers.peursum.scenes import trained_file
from poseppl_papers.peursum.tracks import Track, frames_of, posture_error, posture_of, run_track
from poseppl_papers.recordings import Recording
from poseppl_papers.runs import finished, stacked

ALGORITHMS = ("filter", "FBS", "variational", "Gibbs")
STAGES = ("filter", "FBS", "mixture", "variational", "Gibbs")
"""Stages that are timed (Table 4); the last two use the mixture."""
Judge = Callable[[Any, Any, Floats, Floats], Any]
"""From the tree, a frame's poses (N, d), weights (N,) and truth (15, 3) to its error."""
MAX_PAIRED = 10_000
"""Particles of FBS at most, whose time and memory grow with their square."""


@dataclass(frozen=True)
class SmoothedRuns(Job):
    """Runs of one filter, and the smoothers after it.

    Attributes:
        scene: Scene that is seen.
        system: Tracking system.
        method: The filter.
        runs: Numbers of the runs, which are seeds.
        rounds: Rounds of the Gibbs sampler.
        training: Training data of the motion; None for a generic one.
        training_rate: Frames a second at which it is learned.
        smoothed: Whether smoothers follow.
    """

    scene: Any
    system: System
    method: Method
    runs: tuple[int, ...]
    rounds: int
    training: Recording | None = None
    training_rate: float = 50.0
    smoothed: bool = later_field(True)

    @property
    def length(self) -> int:
        """Frames that are tracked."""
        return int(self.scene.num_frames)

    @property
    def taught(self) -> System:
        """The system with the motion that it learned."""
        if self.training is None:
            return self.system
        return self.system.with_settings(model=trained_file(self.training, self.training_rate))

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"{self.system.name}-{self.scene.name}-{self.method.name}-{self.runs[0]}"

    @property
    def cost(self) -> float:
        """Relative to a second."""
        return 30.0 + len(self.runs) * self.length * float(dict(self.method.settings)["num_particles"]) * 1e-3


@dataclass(frozen=True)
class SmoothedWalk(SmoothedRuns):
    """Runs on the first frames of a walk.

    Attributes:
        num_frames: How many.
    """

    scene: Scene
    num_frames: int = field(kw_only=True)

    @property
    def length(self) -> int:
        """Frames that are tracked."""
        return self.num_frames


class Motion(NamedTuple):
    """Inputs of smoothers from a motion: its tables, which FBS uses unchanged, and their floored logarithms."""

    tables: FactoredTables
    floored: LogTables
    walk: RootWalk
    learned: bool


def smooth_walk(job: SmoothedWalk) -> dict[str, Any]:
    """Run the filter and the smoothers.

    Returns:
        ``errors`` (run, algorithm, frame), mm, by :data:`ALGORITHMS`; ``seconds`` a frame (run, algorithm), those of smoothers
        in the first run with compilation; ``stages``, the same by :data:`STAGES`, the mixture
        apart; ``rounds`` of the variational smoother (run,); ``ess_share`` and ``survivors``
        (run,), mean shares of N that are effective, and that have descendants three frames later, NaN where a filter has no
        ancestors. Without smoothers there is one algorithm, and no ``stages`` and ``rounds``.
    """
    system = job.taught
    problem = problem_of(job.scene, system, job.num_frames)
    if job.training is None:
        filter, step = compiled_step(job.scene, system, job.num_frames, job.method)
    else:
        filter = job.method.build(problem)
        step = jit(filter.step)
    motion = motion_of(problem, system)
    rows = []
    for run in job.runs:
        track = run_track(problem, filter, step, run)
        rows.append(smooth_track(problem, track, motion, job.rounds, run) if job.smoothed else filter_track(problem, track))
    return stacked(rows)


def motion_of(problem: Problem, system: System) -> Motion:
    """The motion of a system, or the diffusion of a generic one in bins."""
    inputs, places = problem.frames[0], root_places(problem.system.tree.coordinates)
    scales = np.asarray(inputs.step_scale, np.float64)
    file = dict(system.settings).get("model")
    tables = diffusion_tables(jnp.asarray(np.delete(scales, places), float), NUM_BINS)
    if file is not None:
        tables = read_factored_motion(file).tables
    seconds = 0.0 if inputs.seconds is None else inputs.seconds
    walk = RootWalk(jnp.asarray(scales[places], float), tables.velocities * seconds, jnp.asarray(tables.stays, float))
    return Motion(tables, log_tables(tables), walk, file is not None)


def filter_track(problem: Problem, track: Track, judge: Judge = posture_error) -> dict[str, Any]:
    """Errors (1, frame), seconds (1,), ``ess_share`` and ``survivors`` of the filter, as :func:`smooth_walk` has them."""
    weights, survivors = _weights(track), track.survivors() / track.log_weights.shape[1]
    return {
        "errors": _judged(problem, track.poses, weights, judge)[None],
        "seconds": np.array([np.nanmedian(track.seconds)]),
        "ess_share": track.ess_share.mean(),
        "survivors": survivors.mean() if survivors.min() < 1 else np.nan,
    }


def smooth_track(
    problem: Problem, track: Track, motion: Motion, rounds: int, seed: int, judge: Judge = posture_error
) -> dict[str, Any]:
    """The estimates of a run: errors (algorithm, frame), seconds (algorithm,) and the rest, as :func:`smooth_walk` has them.

    Args:
        problem: A system before a scene.
        track: The filter's particles.
        motion: Inputs of smoothers from the motion.
        rounds: Rounds of the Gibbs sampler.
        seed: Seed of the run.
        judge: Error of a frame.
    """
    key_fit, key_gibbs = jax.random.split(jax.random.key(seed + 1000))
    filtered, weights = filter_track(problem, track, judge), _weights(track)
    errors, seconds = list(filtered["errors"]), list(filtered["seconds"])
    if weights.shape[1] <= MAX_PAIRED:
        smoothed, spent = finished(lambda: forward_backward(problem, track, motion))
        errors.append(_judged(problem, track.poses, np.exp(np.asarray(smoothed, np.float64)), judge))
    else:
        spent = np.nan
        errors.append(np.full_like(errors[0], np.nan))
    seconds.append(spent / len(weights))
    mixtures, fitted = finished(lambda: _fit(key_fit, track.rotations, track.particles.roots, track.log_weights))
    smoothers: list[Callable[[], tuple[FactoredPosterior, Any]]] = [
        lambda: _variational(motion, mixtures, track),
        lambda: (_gibbs(key_gibbs, motion.floored, mixtures, first_draw(mixtures, track), rounds), 0),
    ]
    counts, stages = [], [*seconds, fitted / len(weights)]
    for smoother in smoothers:
        (posterior, count), spent = finished(smoother)
        poses = posture_of(problem.system.tree, posterior.root_mean, posterior.mean_rotations())
        errors.append(_judged(problem, poses[:, None], np.ones((len(poses), 1)), judge))
        stages.append(spent / len(weights))
        seconds.append(stages[2] + stages[-1])
        counts.append(int(count))
    found = {"errors": np.array(errors), "seconds": np.array(seconds), "stages": np.array(stages), "rounds": counts[0]}
    return filtered | found


def _weights(track: Track) -> Floats:
    return np.exp(np.asarray(track.log_weights, np.float64))


def _judged(problem: Problem, poses: Any, weights: Floats, judge: Judge) -> Floats:
    """The errors (T, ...) of poses (T, N, d) with weights (T, N)."""
    rows = zip(np.asarray(poses), weights, problem.truth, strict=True)
    return np.array([judge(problem.system.tree, *row) for row in rows])


def forward_backward(problem: Problem, track: Track, motion: Motion) -> Array:
    """Smoothed log-weights (T, N)."""
    if motion.learned:
        frames, exact = frames_of(track.particles), log_tables(motion.tables, 0.0)

        def densities(t: int) -> Array:
            found: Array = _log_matrix(exact, motion.walk, frames[t + 1], frames[t])
            return found
    else:
        scales = jnp.asarray(problem.frames[0].step_scale, float)

        def densities(t: int) -> Array:
            found: Array = _log_walk(scales, track.states[t + 1], track.states[t])
            return found

    rows = [track.log_weights[-1]]
    for t in range(len(track.states) - 2, -1, -1):
        rows.append(reweigh(densities(t), rows[-1], track.log_weights[t]))
    return jnp.stack(rows[::-1])


def first_draw(mixtures: Mixtures, track: Track) -> Draw:
    """The most likely particle of each frame, and the component next to it."""
    rows, best = jnp.arange(len(track.log_weights)), jnp.argmax(track.log_weights, 1)
    own = jax.tree.map(lambda leaf: leaf[rows, best], track.particles)
    apart = jnp.square(track.rotations[rows, best][:, None] - mixtures.rotations).sum(-1)
    chosen = jnp.argmin(jnp.where(jnp.isfinite(mixtures.log_weights), apart, jnp.inf), 1)
    return Draw(own.phases, own.bins, chosen, own.roots)


_fit = jit(fit_mixtures, static_argnames="max_components")
_log_matrix = jit(log_transition_matrix)
_log_walk = jit(log_walk_matrix)
_gibbs = jit(gibbs, static_argnames="num_rounds")
_mean_field = jit(mean_field, static_argnames="max_rounds")


def _variational(motion: Motion, mixtures: Mixtures, track: Track) -> tuple[FactoredPosterior, Array]:
    own, sizes = track.particles, (motion.tables.phases.shape[0], NUM_BINS)
    start = start_marginals(own.phases, own.bins, track.log_weights, sizes, mixtures)
    posterior, _, count = _mean_field(motion.floored, mixtures, start)
    return posterior, count
