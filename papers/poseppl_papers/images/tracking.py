"""Runs of a filter on the frames of a scene, two trackers that see nothing, which frame its errors; and a part's tasks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.filters import Filter
from poseppl.jobs import Job
from poseppl.motion.geometry import marker_positions
from poseppl.motion.tracking.marker_errors import marker_errors, virtual_markers
from poseppl.program.population import log_likelihoods
from poseppl_papers.experiment import Task
from poseppl_papers.images.scenes import Rendering, Scene, render
from poseppl_papers.images.systems import Method, Problem, System, problem_of
from poseppl_papers.runs import blocks_of, finished, stacked

FIGURES = ("absolute", "relative", "weighted_relative", "optimistic")
HOLDING, CLOSEST = "(holds the first pose)", "(closest pose)"
"""Trackers that see nothing: one keeps the first pose, the other gets the truth and takes the body's closest pose."""
_BLOCK = 250


@dataclass(frozen=True)
class Blind(Job):
    """The errors of the two trackers that see nothing.

    Attributes:
        scene: Scene that is seen.
        system: Whose body it is.
        num_frames: How many frames of the scene.
    """

    scene: Scene
    system: System
    num_frames: int

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"blind-{self.system.name}-{self.scene.name}"


@dataclass(frozen=True)
class Tracking(Job):
    """Runs of one filter.

    Attributes:
        scene: Scene that is seen.
        system: Tracking system.
        num_frames: How many frames of the scene.
        method: The filter.
        runs: Numbers of the runs, which are seeds.
        weighs: Whether the mean likelihood of the particles is taken, which costs an evaluation of each.
    """

    scene: Scene
    system: System
    num_frames: int
    method: Method
    runs: tuple[int, ...]
    weighs: bool = False

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"{self.system.name}-{self.scene.name}-{self.method.name}-{self.runs[0]}"

    @property
    def cost(self) -> float:
        """Relative to a second."""
        settings = dict(self.method.settings)
        evaluations = settings["num_particles"] * settings.get("num_layers", 1)
        return 20.0 + len(self.runs) * self.num_frames * float(evaluations) * 1e-4


def blind(job: Blind) -> dict[str, Any]:
    """Score the two.

    Returns:
        ``errors`` (tracker, frame, figure): the first holds the first pose, the second takes the closest.
    """
    problem = problem_of(job.scene, job.system, job.num_frames)
    fitted = problem.system.fitted[: job.num_frames]
    trackers = (fitted[:1].repeat(len(fitted), 0), fitted)
    one = np.ones(1)
    return {
        "errors": np.array([[score(problem, x[None], one, t) for t, x in enumerate(states)] for states in trackers], np.float64)
    }


def track(job: Tracking) -> dict[str, Any]:
    """Run the filter.

    Returns:
        For each run and frame: ``errors`` (run, frame, figure), mm, the figures being :data:`FIGURES`; ``seconds``,
        ``ess_share``, ``failed`` and ``weight``, the particles' mean likelihood, NaN where it was not asked for, (run, frame);
        ``evaluations`` of the likelihood a frame (run,).
    """
    problem = problem_of(job.scene, job.system, job.num_frames)
    filter, step = compiled_step(job.scene, job.system, job.num_frames, job.method)
    rows = [run_once(problem, step, first_state(problem, filter, run), run, job.weighs) for run in job.runs]
    return stacked(rows)


@lru_cache(maxsize=4)
def compiled_step(scene: Scene, system: System, num_frames: int, method: Method) -> tuple[Filter, Callable[..., Any]]:
    """The filter, and its step, run once so that it is compiled."""
    problem = problem_of(scene, system, num_frames)
    filter = method.build(problem)
    step: Any = jit(filter.step)
    started = first_state(problem, filter, 0)
    finished(step, jax.random.key(0), started, problem.model.observe({}), problem.frames[0])
    return filter, step


def first_state(problem: Problem, filter: Filter, seed: int) -> Any:
    """The state before frame 0, which is a step like any other, so that one program is compiled: the start's mean.

    A step of the walk makes it the Gaussian start. DE-MC's population, which may not walk, is spread already.
    """
    inputs, start = problem.frames[0], problem.first()
    like = jax.eval_shape(filter.init, jax.random.key(0), problem.model.observe({}), inputs)[0]
    spread: Any = 0.0
    if "velocity" in like._fields:
        spread = jax.random.normal(jax.random.key(seed), like.particles.shape) * inputs.start_scale
    known = {
        "particles": jnp.broadcast_to(start, like.particles.shape) + spread,
        "log_weights": jnp.full(like.log_weights.shape, -np.log(len(like.particles))),
        "best": start,
        "velocity": jnp.zeros_like(start),
    }
    return like._replace(**{name: known[name].astype(getattr(like, name).dtype) for name in like._fields})


def run_once(problem: Problem, step: Callable[..., Any], state: Any, seed: int, weighs: bool) -> dict[str, Any]:
    """One run over all frames."""
    key, data = jax.random.key(seed + 1), problem.model.observe({})
    rows: list[tuple[Any, ...]] = []
    for number, inputs in enumerate(problem.frames):
        (state, info), seconds = finished(step, jax.random.fold_in(key, number), state, data, inputs)
        errors = score(
            problem, problem.poses(state.particles, number), np.exp(np.asarray(state.log_weights, np.float64)), number
        )
        weight = average_weight(problem.model, state.particles, inputs) if weighs else np.nan
        rows.append((errors, seconds, float(info.ess) / len(state.particles), int(info.failed), weight))
    names = ("errors", "seconds", "ess_share", "failed", "weight")
    found = {name: np.array(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}
    return found | {"evaluations": int(info.num_likelihood)}


def score(problem: Problem, poses: Any, weights: Floats, frame: int) -> list[float]:
    """The figures of one frame, of poses (N, d) and weights (N,)."""
    tree = problem.system.tree
    places = virtual_markers(tree.marker_names, _places(tree, jnp.asarray(poses, float)))
    found = marker_errors(places[None], weights[None], problem.truth[None, frame])
    return [float(np.mean(getattr(found, name))) for name in FIGURES]


@jit
def _places(tree: Any, states: Array) -> Array:
    return jax.vmap(partial(marker_positions, tree))(states)


def average_weight(model: Any, particles: Array, inputs: Any) -> float:
    """Mean likelihood of particles (N, d), taken in blocks of one size, so that every filter's are compiled together."""
    blocks = np.array_split(np.arange(len(particles)), -(-len(particles) // _BLOCK))
    values = [
        np.asarray(_likelihoods(model, particles[np.resize(block, _BLOCK)], inputs))[: len(block)].astype(np.float64)
        for block in blocks
    ]
    return float(np.mean(np.exp(np.concatenate(values))))


@partial(jit, static_argnums=0)
def _likelihoods(model: Any, states: Array, inputs: Any) -> Array:
    return log_likelihoods(model, states, model.observe({}), inputs)


def tracking_tasks(
    scenes: Sequence[Scene],
    rivals: Iterable[tuple[System, Method]],
    num_frames: int,
    num_runs: int,
    *,
    weighs: bool = False,
) -> dict[str, Task]:
    """Render the scenes, then run each system's filters on them.

    Args:
        scenes: The scenes.
        rivals: Systems, each with a filter.
        num_frames: How many frames of a scene.
        num_runs: How many runs of each filter.
        weighs: Whether the particles' mean likelihood is taken.

    Returns:
        The tasks "scenes", "blind" and "tracking".
    """
    pairs = list(rivals)
    systems = dict.fromkeys(system for system, _ in pairs)
    sightless = [Blind(scene, system, num_frames) for system in systems for scene in scenes]
    tracked = [
        Tracking(scene, system, num_frames, method, runs, weighs)
        for system, method in pairs
        for scene in scenes
        for runs in blocks_of(num_runs, 5)
    ]
    return {
        "scenes": Task(render, [Rendering(scene) for scene in scenes]),
        "blind": Task(blind, sightless),
        "tracking": Task(track, tracked),
    }
