"""Jobs: a tracker on a scene, seen as points by one camera, for several seeds."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.filters import Filter, assumed_density_filter, covariance_scaled_filter, particle_filter
from poseppl.jobs import Job
from poseppl.jobs.job import later_field
from poseppl.motion.bodies.body import load_builder
from poseppl.motion.geometry import Cameras, look_at, marker_positions, project
from poseppl.motion.geometry.kinematic_jumps import kinematic_jumps
from poseppl.program import CompiledModel, StateSpaceModel
from poseppl_papers.recordings import BUILT_IN, Recording
from poseppl_papers.runs import stacked
from poseppl_papers.sminchisescu_triggs.motions import BEGIN, Moving, axis_of_motion, moving
from poseppl_papers.sminchisescu_triggs.survival import lost_at
from poseppl_papers.sminchisescu_triggs.trackers import TRACKERS, Tracker, search_settings

FOCAL, DISTANCE = 1000.0, 4500.0
"""Focal length of the camera, px, and its distance from the middle of the path, mm."""
NOISE = 3.0
"""Standard deviation of points, px."""
OUTLIERS, ASTRAY = 0.1, 80.0
"""In a cluttered room: share of points that are somewhere else, and how far that is at most to either side, px."""
POSITION_STEP, ANGLE_STEP = 100.0, 1.0
"""Standard deviations of the walk in a second, mm and radians."""
_START = (20.0, 0.1)
_METRE = 1000.0
_BODY = "poseppl_models.sminchisescu_triggs.body:superquadric_body"


@dataclass(frozen=True)
class Tracks(Job):
    """Runs of a tracker on a scene.

    Attributes:
        scene: As :func:`poseppl_papers.sminchisescu_triggs.motions.moving` takes it.
        kind: The body.
        recording: Whose motion it is, where it is a recorded one.
        rate: Frames a second.
        seconds: How long the scene is.
        cluttered: Whether points go astray.
        tracker: One of TRACKERS.
        seeds: Seeds of motions and noise.
        apart: Whether parts are kept out of each other, by trackers that do not say.
        along: Whether the camera looks along the direction in which hands and feet move most.
        begin: Second of the recording at which its motion begins.
    """

    scene: str
    kind: str
    recording: Recording
    rate: float
    seconds: float
    cluttered: bool
    tracker: str
    seeds: tuple[int, ...]
    apart: bool = False
    along: bool = False
    begin: float = later_field(BEGIN)

    @property
    def name(self) -> str:
        """Scene and tracker."""
        return f"{self.motion}-{self.rate:g}-{'cluttered' if self.cluttered else 'black'}-{self.tracker}"

    @property
    def motion(self) -> str:
        """The scene's name in tables."""
        if self.scene != "recorded":
            return self.scene
        return self.recording.name if self.begin == BEGIN else f"{self.recording.name}, {self.begin:g} s"


class Scene(NamedTuple):
    """A motion and what a camera saw of it: points (T, 1, K, 2), px."""

    motion: Moving
    camera: Cameras
    points: Floats


def scene_of(job: Tracks, seed: int) -> Scene:
    """The scene of a seed."""
    own = seed if job.recording == BUILT_IN else 0
    motion = moving(job.scene, job.kind, job.recording, job.rate, job.seconds, own, job.begin)
    middle = np.median(motion.markers.reshape(-1, 3), axis=0)
    axis = axis_of_motion(motion.body.tree.marker_names, motion.markers) if job.along else np.array([0.0, 1.0])
    eye = middle - DISTANCE * np.append(axis, 0.0) + [0.0, 0.0, 300.0]
    camera = look_at(tuple(eye), tuple(middle), FOCAL)
    exact = np.asarray(jax.vmap(lambda places: project(camera, places))(jnp.asarray(motion.markers, float)), np.float64)
    rng = np.random.default_rng([seed, 2])
    points = exact + NOISE * rng.normal(size=exact.shape)
    if job.cluttered:
        astray = rng.random(exact.shape[:-1]) < OUTLIERS
        points = np.where(astray[..., None], exact + rng.uniform(-ASTRAY, ASTRAY, exact.shape), points)
    return Scene(motion, camera, points)


def _filter(model: Any, tracker: Tracker, kind: str) -> tuple[Filter, Callable[[Any], Estimate]]:
    """A tracker's filter, and what it answers."""
    if tracker.draws:
        return assumed_density_filter(model), all_draws
    if tracker.particles:
        return particle_filter(model, tracker.particles), all_draws
    jumps = _jumps(kind) if tracker.jumps else None
    return covariance_scaled_filter(model, 1, **search_settings(tracker, kind), jumps=jumps), heaviest_mode


@lru_cache(maxsize=4)
def _jumps(kind: str) -> Any:
    """The jumps of a body, one object for all runs, so that they share a compiled filter."""
    return kinematic_jumps(load_builder(_BODY)(kind).tree)


class Estimate(NamedTuple):
    """Output of a tracker.

    Attributes:
        states: One mode, or all draws (N, d).
        weights: Normalised (N,).
        covariance: Covariance of the mode or the draws (d, d).
        modes: How many there are; NaN of draws.
    """

    states: Array
    weights: Floats
    covariance: Floats
    modes: float

    def mean_of(self, places: Callable[[Array], Array]) -> Floats:
        """The mean of what a state (d,) tells."""
        return np.tensordot(self.weights, np.asarray(jax.vmap(places)(self.states), np.float64), 1)


def heaviest_mode(state: Any) -> Estimate:
    """The heaviest mode."""
    weights = np.asarray(state.modes.log_weights)
    best = int(weights.argmax())
    covariance = np.asarray(state.modes.covariances[best], np.float64)
    return Estimate(state.modes.means[best][None], np.ones(1), covariance, int(np.isfinite(weights).sum()))


def all_draws(state: Any) -> Estimate:
    """All draws by their weights."""
    draws = state.particles.reshape(-1, state.particles.shape[-1])
    weights = np.asarray(jax.nn.softmax(state.log_weights.reshape(-1)), np.float64)
    return Estimate(draws, weights, np.cov(np.asarray(draws, np.float64).T, aweights=weights), np.nan)


def track(job: Tracks) -> dict[str, Any]:
    """Track a scene until its end, or until the body is lost.

    Returns:
        For each seed: ``lost`` (s), inf where the body was kept; ``error``, mean distance (mm) of the markers from the truth
        while it was kept; ``ratio``, geometric mean over frames of the largest over the smallest standard deviation of the
        heaviest mode, metres and radians; ``modes``, mean number of modes; ``seconds`` of the processor a frame.
    """
    return stacked([_track_one(job, seed) for seed in job.seeds])


def _track_one(job: Tracks, seed: int) -> dict[str, float]:
    tracker, scene = TRACKERS[job.tracker], scene_of(job, seed)
    body, truth = scene.motion.body, scene.motion.markers
    inputs, model = compiled_model(job, tracker, scene)
    built, estimate = _filter(model, tracker, job.kind)
    observations = [model.observe(data_of(model, points)) for points in scene.points]

    def error(frame: int, found: Estimate) -> float:
        return marker_error(found.mean_of(partial(marker_positions, body.tree)), truth[frame])

    frames = [(observation, inputs) for observation in observations]
    return follow(built, seed, job.rate, len(frames), lambda frame, _: frames[frame], error, estimate=estimate)


def follow(
    built: Filter,
    seed: int,
    rate: float,
    num_frames: int,
    frame_of: Callable[[int, Any], tuple[Any, Any]],
    error_of: Callable[[int, Estimate], float],
    start: Any = None,
    estimate: Callable[[Any], Estimate] = heaviest_mode,
) -> dict[str, float]:
    """Run a tracker until the end, or until the body is lost; what is returned is as that of :func:`track`, for one seed.

    Args:
        built: The tracker.
        seed: Seed of the run.
        rate: Frames a second.
        num_frames: How many frames.
        frame_of: From a frame, and the pose of the heaviest mode in the one before, to the data and the inputs.
        error_of: From a frame and an estimate to the error, mm.
        start: The pose before the first frame.
        estimate: From a state to what the tracker answers.
    """
    first, best, key = frame_of(0, start), start, jax.random.key(seed)
    begin, step = _compiled_steps(built)
    state = None if built.initial_state is None else built.initial_state(*first)
    ready: Any = jax.block_until_ready
    ready(step(key, begin(key, *first)[0] if state is None else state, *first))  # compiled before the clock starts
    errors, ratios, modes, began = [], [], [], time.process_time()
    for frame in range(num_frames):
        own, data = jax.random.fold_in(key, frame), frame_of(frame, best)
        state, _ = begin(own, *data) if state is None else step(own, state, *data)
        found = estimate(state)
        best = found.states[0]
        errors.append(error_of(frame, found))
        ratios.append(_ratio(found.covariance))
        modes.append(found.modes)
        lost = lost_at(np.array(errors), rate)
        if np.isfinite(lost):
            break
    kept = errors[: round(lost * rate)] if np.isfinite(lost) else errors
    return {
        "lost": lost,
        "error": float(np.mean(kept)) if kept else float("nan"),
        "ratio": float(np.exp(np.mean(np.log(ratios)))),
        "modes": float(np.mean(modes)),
        "seconds": (time.process_time() - began) / len(errors),
    }


@lru_cache(maxsize=8)
def _compiled_steps(built: Filter) -> tuple[Any, Any]:
    return jit(built.init), jit(built.step)


def compiled_model(job: Tracks, tracker: Tracker, scene: Scene) -> tuple[Any, Any]:
    """Inputs of every frame, and the compiled model."""
    programs = load_builder("poseppl_models.sminchisescu_triggs.programs:point_programs")
    make_inputs = load_builder("poseppl_models.sminchisescu_triggs.programs:point_inputs")
    body = scene.motion.body
    start, step = walk_scales(body, _START, (POSITION_STEP, ANGLE_STEP), job.rate)
    step = step * tracker.noise**0.5 if tracker.particles else step
    noise = np.full((1, len(body.tree.marker_names)), NOISE)
    known = (noise, scene.motion.states[0], start, step)
    own = (scene.camera, *(jnp.asarray(part, float) for part in known), body.tree, body.flesh)
    inputs = make_inputs(*own, robust=tracker.robust)
    parts = job.apart if tracker.parts is None else tracker.parts
    limits = ("barrier" if tracker.draws else "support") if tracker.limits else "none"
    program = programs(job.kind, limits=limits, parts=parts)
    leaves, tree = jax.tree.flatten(jax.eval_shape(lambda values: values, inputs))
    return inputs, _compiled(program, tree, tuple(leaves))


@lru_cache(maxsize=8)
def _compiled(program: StateSpaceModel, tree: Any, shapes: tuple[Any, ...]) -> CompiledModel:
    """One compiled model for all seeds, so that all of them have one filter."""
    return program.compile(jax.tree.unflatten(tree, shapes), {})


def walk_scales(body: Any, start: tuple[float, float], step: tuple[float, float], rate: float) -> tuple[Floats, Floats]:
    """Standard deviations (d,) of the first pose and of a frame's step, from those of places and angles, the step's in 1 s."""
    units = np.where(np.arange(body.tree.dimension) < 3, 0, 1)
    return np.array(start)[units], (np.array(step) / rate**0.5)[units]


def data_of(model: Any, points: Floats) -> dict[str, Floats]:
    """The points of a frame; parts keep apart as if that were observed."""
    return {name: points if name == "points" else np.zeros(site.shape) for name, site in model.observation_sites.items()}


def marker_error(places: Floats, truth: Floats) -> float:
    """Mean distance (mm) of markers (K, 3), both sets moved to their first marker."""
    return float(np.linalg.norm((places - places[0]) - (truth - truth[0]), axis=-1)[1:].mean())


def in_metres(dimension: int) -> Floats:
    """Millimetres or radians (d,) of a coordinate's unit: metres for the first three, radians for the others."""
    return np.where(np.arange(dimension) < 3, _METRE, 1.0)


def _ratio(covariance: Floats) -> float:
    """Largest over smallest standard deviation of a covariance (d, d), its first three coordinates in metres."""
    units = in_metres(len(covariance))
    values = np.linalg.eigvalsh(covariance / np.outer(units, units))
    return float(np.sqrt(values[-1] / max(values[0], 1e-16)))
