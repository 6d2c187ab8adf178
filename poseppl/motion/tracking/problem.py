"""The inference problem of a scene: a compiled model, its data and its inputs, ready for any filter or smoother.

Example:
    A filter of one's own on a scene::

        problem = make_problem(scene)
        collect = problem.collector(200)
        run = run_filter(hmc_filter(problem.model), key, problem.observations, problem.inputs, collect=collect)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jax import Array

from poseppl.arrays import Floats
from poseppl.errors import Argument, InputError, Phrase
from poseppl.motion.bodies.body import Body, Posture
from poseppl.motion.geometry import Cameras, marker_positions, project
from poseppl.motion.tracking.point_data import PointData
from poseppl.motion.tracking.recorded_model import recorded_model
from poseppl.motion.tracking.scene import Scene, SceneData
from poseppl.motion.tracking.start import start_scales
from poseppl.motion.tracking.walk import mean_reverting_steps, step_scales, time_steps
from poseppl.program import Clamped, CompiledModel, Observation, clamp
from poseppl.program.memoized_builder import memoized_builder
from poseppl.runs.collectors import collect_draws
from poseppl.runs.contents import arrays_of
from poseppl.runs.frame_sequence import rows_of_inputs
from poseppl.runs.results import provenance
from poseppl.runs.run import Collect, Constant, frame_inputs


class Problem(NamedTuple):
    """The inference problem of a scene.

    Attributes:
        body: The body.
        model: Its compiled model; of the free coordinates alone, where the others are clamped.
        observations: The scene's data with a leading T.
        inputs: Cameras, noise and start, as :func:`poseppl.runs.run.run_filter` takes them.
        pose: The body's pose (d,) from a state and the frame's inputs; None if the state is the pose.
        follows: From the same, 1 if the state follows the learned prior, else 0; None unless there is such a prior that may be
            wrong.
        markers: From the same, the markers (K, 3); None if they are those of the pose.
        cameras: From the same, the cameras; None if they are those of the inputs.
        num_static: How many of the state's last coordinates do not change.
    """

    body: Body
    model: CompiledModel
    observations: Observation
    inputs: Any
    pose: Callable[[Array, Any], Array] | None = None
    follows: Callable[[Array, Any], Array] | None = None
    markers: Callable[[Array, Any], Array] | None = None
    cameras: Callable[[Array, Any], Cameras] | None = None
    num_static: int = 0

    @property
    def num_cameras(self) -> int:
        """C."""
        return int(body_inputs(self.inputs).cameras.value.centre.shape[0])

    def first_frames(self, count: int) -> Problem:
        """The problem of the first frames alone."""

        def first(leaf: Any) -> Any:
            return leaf if isinstance(leaf, Constant) else leaf[:count]

        inputs = jax.tree.map(first, self.inputs, is_leaf=lambda leaf: isinstance(leaf, Constant))
        return self._replace(observations=jax.tree.map(first, self.observations), inputs=inputs)

    def collector(self, max_draws: int) -> Collect:
        """Collector of draws, with the markers and their projections beside them."""
        if self.pose is None:
            return collect_draws(self.model, max_draws=max_draws, extras=_with_projections(self.model))
        return _collect_poses(self.model, self.pose, self.follows, self.markers, self.cameras, max_draws)

    def record(self, frames: slice = slice(None)) -> dict[str, Any]:
        """The inputs as arrays by name, from which :func:`problem_of_result` makes the problem again; cameras left out.

        Args:
            frames: Which frames of what changes from frame to frame.
        """
        seen = rows_of_inputs(self.inputs, frames)
        own = body_inputs(seen)
        record = {"noise": own.noise, "start": own.start, "start_scale": own.start_scale}
        record["step_scale"] = own.step_scale[:, list(self.body.free_coordinates)]
        record["marker_offsets"] = self.body.tree.marker_offsets
        if own.posture is not None:
            record |= {"posture_mean": own.posture.mean, "posture_kept": own.posture.kept}
        if self.body.free is not None:
            record["states"] = seen.values
        return {name: np.asarray(values) for name, values in record.items()}


@memoized_builder
def _with_projections(model: CompiledModel) -> Callable[[Array, Any], dict[str, Array]]:
    """The model's extras, and where its markers are seen."""

    def extras(x: Array, inputs: Any) -> dict[str, Array]:
        values = model.extras(x, inputs)
        return {**values, "points": project(body_inputs(inputs).cameras, values["markers"])} if "markers" in values else values

    return extras


@memoized_builder
def _collect_poses(
    model: CompiledModel,
    pose: Callable[[Array, Any], Array],
    follows: Callable[[Array, Any], Array] | None,
    markers: Callable[[Array, Any], Array] | None,
    cameras: Callable[[Array, Any], Cameras] | None,
    max_draws: int,
) -> Collect:
    """The collector of states whose pose is another; ``prior_mean`` is the probability that they follow the prior."""

    def seen(x: Array, inputs: Any) -> dict[str, Array]:
        places = marker_positions(inputs.tree, pose(x, inputs)) if markers is None else markers(x, inputs)
        eyes = inputs.cameras if cameras is None else cameras(x, inputs)
        return {"pose": pose(x, inputs), "markers": places, "points": project(eyes, places)}

    collect = collect_draws(model, max_draws=max_draws, extras=seen)

    def collect_poses(rng_key: Array, state: Any, info: Any, inputs: Any) -> Any:
        drawn = collect(rng_key, state, info, inputs)
        kept = {**drawn.extras}
        summary = {name: values for name, values in drawn.summary.items() if not name.startswith("state_")}
        summary = {name.replace("pose_", "state_"): values for name, values in summary.items()}
        if follows is not None:
            share = jax.nn.softmax(state.log_weights) @ jax.vmap(lambda x: follows(x, inputs))(state.particles)
            summary["prior_mean"] = share
        return drawn._replace(state=kept.pop("pose"), extras=kept, summary=summary)

    return collect_poses


def body_inputs(inputs: Any) -> Any:
    """The inputs of the body's own programs, whether or not some of its joints are clamped."""
    return inputs.inputs if isinstance(inputs, Clamped) else inputs


def with_steps(inputs: Any, step_scale: Any) -> Any:
    """The same inputs with other steps of the random walk."""
    return _with(inputs, step_scale=step_scale)


def with_tree(inputs: Any, tree: Any) -> Any:
    """The same inputs with another person's tree."""
    return _with(inputs, tree=tree)


def _with(inputs: Any, **changed: Any) -> Any:
    own = body_inputs(inputs)._replace(**changed)
    return inputs._replace(inputs=own) if isinstance(inputs, Clamped) else own


def make_problem(
    scene: Scene[SceneData],
    params: Mapping[str, float] | None = None,
    start: Floats | None = None,
    *,
    mean_reverting: bool = False,
) -> Problem:
    """Pose the problem of a scene.

    Args:
        scene: The scene.
        params: The programs' params; the body's own if None.
        start: State (d,) one step of the random walk before the first; if None, the true state if it is known. Otherwise the
            first state is estimated from the data, with a larger standard deviation.
        mean_reverting: Whether angles revert to the usual posture of people.

    Raises:
        InputError: The body clamps joints to a truth that is not known, it has no posture, or the data have no
            start.
    """
    body = scene.body
    params = dict(body.params if params is None else params)
    known = scene.states[0] if start is None and scene.states is not None else start
    if known is None:
        mean, scale = scene.data.seek(scene, params), start_scales(body)
    else:
        mean, scale = known, step_scales(body, params)
    seconds = time_steps(scene.frames, scene.rate)
    walk = mean_reverting_steps(body, params, seconds) if mean_reverting else (step_scales(body, params, seconds), None)
    return _problem(body, params, scene.data, _walk(body, scene.cameras, mean, scale, *walk), scene.states)


def with_frames(problem: Problem, data: SceneData, count: int) -> Problem:
    """The same problem of other frames, whose body's joints are all free; the walk to each is that to the first.

    Args:
        problem: The problem of a scene.
        data: Observations of these frames.
        count: How many there are.
    """
    own = problem.inputs
    walk = {name: getattr(own, name) for name in ("cameras", "start", "start_scale", "tree", "posture")}
    if own.posture is not None:
        walk["posture"] = own.posture._replace(kept=own.posture.kept[:1].repeat(count, axis=0))
    inputs = data.inputs(problem.body, {**walk, "step_scale": own.step_scale[:1].repeat(count, axis=0)})
    return problem._replace(observations=data.observe(problem.model), inputs=inputs)


def problem_of_result(tree: xr.DataTree, model: str | None = None, data: SceneData | None = None) -> Problem:
    """Pose the problem of a tracking result again, from its provenance.

    Args:
        tree: The result.
        model: Builder of the body; needed if the result's own is not installed, because a file never chooses which code runs.
        data: Observations, if they are not the points in the result, which has no pictures of silhouettes.

    Raises:
        InputError: The result does not come from `track`, or is of an older layout, or its model is not installed. Also if it
            was tracked with a learned prior, which is not in it.
    """
    if "prior" in provenance(tree):
        message = "the result was tracked with a learned prior, which is not in it"
        raise InputError(message, field=Argument("prior"), expected=Phrase(Argument("prior", "FILE"), ", the prior's file"))
    return walk_of_result(tree, model, data)


def walk_of_result(tree: xr.DataTree, model: str | None = None, data: SceneData | None = None) -> Problem:
    """The same of a body that walks at random, whatever prior the result was tracked with."""
    inputs, calibration = arrays_of(tree, "inputs"), arrays_of(tree, "camera")
    if "step_scale" not in inputs or not calibration:
        raise InputError("the result does not contain its inputs", expected="a result of poseppl track of this version")
    _, body, params = recorded_model(tree, model)
    cameras = Cameras(**{name: jnp.asarray(calibration[name], float) for name in Cameras._fields if name in calibration})
    posture = Posture(*(inputs[f"posture_{part}"] for part in Posture._fields)) if "posture_mean" in inputs else None
    walk = _walk(body, cameras, inputs["start"], inputs["start_scale"], _steps_of_result(inputs, body, params), posture)
    seen = points_of_result(tree) if data is None else data
    return _problem(body, params, seen, walk, inputs.get("states"))


def points_of_result(tree: xr.DataTree) -> PointData:
    """The points that a result was tracked by.

    Raises:
        InputError: It has none.
    """
    points = np.asarray(tree["observed_data"].dataset["points"].values)
    if np.isnan(points).all():
        raise InputError(
            "the result has no points: it comes from silhouettes, and does not contain their pictures",
            expected=Phrase("a result of points; or track it with ", Argument("smooth", "METHOD")),
        )
    return PointData(points, arrays_of(tree, "inputs")["noise"])


def _steps_of_result(inputs: Mapping[str, Any], body: Body, params: Mapping[str, float]) -> Floats:
    """The recorded steps (T, d); those of clamped coordinates, which nothing depends on, are the published ones."""
    free = np.asarray(inputs["step_scale"], np.float64)
    steps = np.tile(step_scales(body, params), (len(free), 1))
    steps[:, list(body.free_coordinates)] = free
    return steps


def _walk(
    body: Body, cameras: Cameras, start: Any, start_scale: Any, steps: Floats, posture: Posture | None = None
) -> dict[str, Any]:
    """Inputs by name that do not depend on what was seen."""
    return {
        "cameras": Constant(cameras),
        "start": Constant(jnp.asarray(start, float)),
        "start_scale": Constant(jnp.asarray(start_scale, float)),
        "step_scale": jnp.asarray(steps, float),
        "tree": Constant(body.tree),
        "posture": posture and Posture(Constant(jnp.asarray(posture.mean, float)), jnp.asarray(posture.kept, float)),
    }


def _problem(body: Body, params: Mapping[str, float], data: SceneData, walk: Mapping[str, Any], states: Any) -> Problem:
    inputs = data.inputs(body, walk)
    model = body.compile(frame_inputs(inputs, 0), params)
    observations = data.observe(model)
    if body.free is None:
        return Problem(body, model, observations, inputs)
    if states is None:
        raise InputError("the body clamps joints to a truth that is not known", field=Argument("model"))
    whole = Clamped.of_trajectory(jnp.asarray(states, float), inputs)
    return Problem(body, clamp(model, body.free_coordinates), observations, whole)
