"""Jobs: a tracker on a scene, seen as points by one camera, for several seeds."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from poseppl.arrays import Floats
from poseppl.experiments.jobs import Job
from poseppl.experiments.recordings import BUILT_IN, Recording
from poseppl.experiments.sminchisescu_triggs.motions import Moving, moving
from poseppl.experiments.sminchisescu_triggs.programs import shipped
from poseppl.experiments.sminchisescu_triggs.survival import lost_at
from poseppl.experiments.sminchisescu_triggs.trackers import TRACKERS, Tracker, search_settings
from poseppl.filters import Filter, FilterState, assumed_density_filter, covariance_scaled_filter
from poseppl.motion.geometry import Cameras, KinematicTree, look_at, marker_positions, project
from poseppl.program import CompiledModel, StateSpaceModel

FOCAL, DISTANCE = 1000.0, 4500.0
"""Of the camera: px, and mm from the middle of the path."""
NOISE = 3.0
"""Standard deviation of points, px."""
OUTLIERS, ASTRAY = 0.1, 80.0
"""In a cluttered room: share of points that are somewhere else, and how far that is at most to either side, px."""
POSITION_STEP, ANGLE_STEP = 100.0, 1.0
"""Standard deviations of the walk in a second, mm and radians."""
_START = (20.0, 0.1)
_METRE = 1000.0


@dataclass(frozen=True)
class Tracks(Job):
    """Runs of a tracker on a scene.

    Attributes:
        scene: As :func:`poseppl.experiments.sminchisescu_triggs.motions.moving` takes it.
        kind: The body.
        recording: Whose motion it is, where it is a recorded one.
        rate: Frames a second.
        seconds: How long the scene is.
        cluttered: Whether points go astray.
        tracker: One of TRACKERS.
        seeds: Of motions and noise.
    """

    scene: str
    kind: str
    recording: Recording
    rate: float
    seconds: float
    cluttered: bool
    tracker: str
    seeds: tuple[int, ...]

    @property
    def name(self) -> str:
        """Scene and tracker."""
        return f"{self.motion}-{self.rate:g}-{'cluttered' if self.cluttered else 'black'}-{self.tracker}"

    @property
    def motion(self) -> str:
        """The scene's name in tables."""
        return self.scene if self.scene != "recorded" else self.recording.name


class Scene(NamedTuple):
    """A motion and what a camera saw of it: points (T, 1, K, 2), px."""

    motion: Moving
    camera: Cameras
    points: Floats


def scene_of(job: Tracks, seed: int) -> Scene:
    """The scene of a seed."""
    motion = moving(job.scene, job.kind, job.recording, job.rate, job.seconds, seed if job.recording == BUILT_IN else 0)
    middle = np.median(motion.markers.reshape(-1, 3), axis=0)
    camera = look_at((middle[0], middle[1] - DISTANCE, middle[2] + 300.0), tuple(middle), FOCAL)
    exact = np.asarray(jax.vmap(lambda places: project(camera, places))(jnp.asarray(motion.markers, float)), np.float64)
    rng = np.random.default_rng([seed, 2])
    points = exact + NOISE * rng.normal(size=exact.shape)
    if job.cluttered:
        astray = rng.random(exact.shape[:-1]) < OUTLIERS
        points = np.where(astray[..., None], exact + rng.uniform(-ASTRAY, ASTRAY, exact.shape), points)
    return Scene(motion, camera, points)


def track(job: Tracks) -> dict[str, Any]:
    """Track a scene until its end, or until the body is lost.

    Returns:
        For each seed: ``lost`` (s), inf where the body was kept; ``error``, mean distance (mm) of the markers from the truth
        while it was kept; ``ratio``, geometric mean over frames of the largest over the smallest standard deviation of the
        heaviest mode, metres and radians; ``modes``, mean number of modes; ``seconds`` of the processor a frame.
    """
    rows = [_track_one(job, seed) for seed in job.seeds]
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _track_one(job: Tracks, seed: int) -> dict[str, float]:
    tracker, scene = TRACKERS[job.tracker], scene_of(job, seed)
    body, truth = scene.motion.body, scene.motion.markers
    inputs, model = _model(job, tracker, scene)
    built = (
        assumed_density_filter(model)
        if tracker.draws
        else covariance_scaled_filter(model, 1, **search_settings(tracker, job.kind))
    )
    estimate = _of_draws if tracker.draws else _of_modes
    step = _compiled_step(built)
    observations = [model.observe(_data(model, points)) for points in scene.points]
    assert built.initial_state is not None
    state, key = built.initial_state(observations[0], inputs), jax.random.key(seed)
    ready: Any = jax.block_until_ready
    ready(step(key, state, observations[0], inputs))  # compiled before the clock starts
    errors, ratios, modes, began = [], [], [], time.process_time()
    for frame, observation in enumerate(observations):
        state, _ = step(jax.random.fold_in(key, frame), state, observation, inputs)
        found = estimate(state, body.tree)
        errors.append(_error(found.markers, truth[frame]))
        ratios.append(_ratio(found.covariance))
        modes.append(found.modes)
        lost = lost_at(np.array(errors), job.rate)
        if np.isfinite(lost):
            break
    kept = errors[: round(lost * job.rate)] if np.isfinite(lost) else errors
    return {
        "lost": lost,
        "error": float(np.mean(kept)) if kept else float("nan"),
        "ratio": float(np.exp(np.mean(np.log(ratios)))),
        "modes": float(np.mean(modes)),
        "seconds": (time.process_time() - began) / len(errors),
    }


class Estimate(NamedTuple):
    """What a tracker answers: markers (K, 3), the covariance (d, d) of one mode or of all draws, and how many modes it has."""

    markers: Floats
    covariance: Floats
    modes: float


def _of_modes(state: Any, tree: KinematicTree) -> Estimate:
    """The heaviest mode."""
    weights = np.asarray(state.modes.log_weights)
    best = int(weights.argmax())
    markers = np.asarray(marker_positions(tree, state.modes.means[best]), np.float64)
    return Estimate(markers, np.asarray(state.modes.covariances[best], np.float64), int(np.isfinite(weights).sum()))


def _of_draws(state: FilterState, tree: KinematicTree) -> Estimate:
    """The mean of the draws' markers."""
    draws = state.particles.reshape(-1, state.particles.shape[-1])
    weights = np.asarray(jax.nn.softmax(state.log_weights.reshape(-1)), np.float64)
    markers = np.asarray(jax.vmap(lambda x: marker_positions(tree, x))(draws), np.float64)
    return Estimate(np.tensordot(weights, markers, 1), np.cov(np.asarray(draws, np.float64).T, aweights=weights), np.nan)


@lru_cache(maxsize=8)
def _compiled_step(built: Filter) -> Any:
    return jax.jit(built.step)


def _model(job: Tracks, tracker: Tracker, scene: Scene) -> tuple[Any, Any]:
    """Inputs of every frame, and the compiled model."""
    programs = shipped("sminchisescu_points:point_programs")
    make_inputs = shipped("sminchisescu_points:point_inputs")
    body = scene.motion.body
    units = np.where(np.arange(body.tree.dimension) < 3, 0, 1)
    start, step = (np.array(pair)[units] for pair in (_START, np.array([POSITION_STEP, ANGLE_STEP]) / job.rate**0.5))
    noise = np.full((1, len(body.tree.marker_names)), NOISE)
    known = (noise, scene.motion.states[0], start, step)
    own = (scene.camera, *(jnp.asarray(part, float) for part in known), body.tree, body.flesh)
    inputs = make_inputs(*own, robust=tracker.robust)
    parts = job.kind == "arm" if tracker.parts is None else tracker.parts
    program = programs(job.kind, limits="support" if tracker.limits else "none", parts=parts)
    leaves, tree = jax.tree.flatten(jax.eval_shape(lambda values: values, inputs))
    return inputs, _compiled_model(program, tree, tuple(leaves))


@lru_cache(maxsize=8)
def _compiled_model(program: StateSpaceModel, tree: Any, shapes: tuple[Any, ...]) -> CompiledModel:
    """One compiled model for all seeds, so that all of them have one filter."""
    return program.compile(jax.tree.unflatten(tree, shapes), {})


def _data(model: Any, points: Floats) -> dict[str, Floats]:
    """The points of a frame; parts keep apart as if that were observed."""
    return {name: points if name == "points" else np.zeros(site.shape) for name, site in model.observation_sites.items()}


def _error(places: Floats, truth: Floats) -> float:
    """Mean distance (mm) of markers (K, 3), both sets moved to their first marker."""
    return float(np.linalg.norm((places - places[0]) - (truth - truth[0]), axis=-1)[1:].mean())


def _ratio(covariance: Floats) -> float:
    """Largest over smallest standard deviation of a covariance (d, d), its first three coordinates in metres."""
    units = np.where(np.arange(len(covariance)) < 3, _METRE, 1.0)
    values = np.linalg.eigvalsh(covariance / np.outer(units, units))
    return float(np.sqrt(values[-1] / max(values[0], 1e-16)))
