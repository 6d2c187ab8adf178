"""The inference problem of a scene: a compiled model, its data and its inputs, ready for any filter or smoother.

Example:
    A filter of one's own on a scene::

        problem = pose_problem(scene)
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

from poseppl.errors import InputError
from poseppl.motion.bodies.body import Body, BodyInputs
from poseppl.motion.geometry import Cameras, project
from poseppl.motion.tracking.recorded_model import recorded_model
from poseppl.motion.tracking.scene import Floats, Scene
from poseppl.motion.tracking.start import Start, seek_start
from poseppl.motion.tracking.walk import step_scales, time_steps
from poseppl.program import Clamped, CompiledModel, Observation
from poseppl.program.built_once import built_once
from poseppl.runs.collectors import collect_draws
from poseppl.runs.run import Collect, Constant, frame_inputs


class Problem(NamedTuple):
    """What a scene asks.

    Attributes:
        body: The body.
        model: Its compiled model; of the free coordinates alone, where the others are clamped.
        observations: The points with a leading T.
        inputs: Cameras, noise and start, as :func:`poseppl.runs.run.run_filter` takes them.
    """

    body: Body
    model: CompiledModel
    observations: Observation
    inputs: Any

    @property
    def num_cameras(self) -> int:
        """C."""
        return int(body_inputs(self.inputs).cameras.value.centre.shape[0])

    def collector(self, max_draws: int) -> Collect:
        """Collector of draws, with the markers and their projections beside them."""
        return collect_draws(self.model, max_draws=max_draws, extras=_with_projections(self.model))

    def record(self, frames: slice = slice(None)) -> dict[str, Any]:
        """The inputs as arrays by name, from which :func:`problem_of_result` makes the problem anew; cameras left out.

        Args:
            frames: Which frames of what changes from frame to frame.
        """
        seen = body_inputs(self.inputs)
        noise = seen.noise.value if isinstance(seen.noise, Constant) else seen.noise[frames]
        record = {"noise": noise, "start": seen.start.value, "start_scale": seen.start_scale.value}
        record["step_scale"] = seen.step_scale[frames, list(self.body.free_coordinates)]
        if isinstance(self.inputs, Clamped):
            record["states"] = self.inputs.values[frames]
        return {name: np.asarray(values) for name, values in record.items()}


@built_once
def _with_projections(model: CompiledModel) -> Callable[[jax.Array, Any], dict[str, jax.Array]]:
    """The model's extras, and where its markers are seen."""

    def extras(x: jax.Array, inputs: Any) -> dict[str, jax.Array]:
        values = model.extras(x, inputs)
        return {**values, "points": project(body_inputs(inputs).cameras, values["markers"])} if "markers" in values else values

    return extras


def body_inputs(inputs: Any) -> Any:
    """The inputs of the body's own programs, whether or not some of its joints are clamped."""
    return inputs.inputs if isinstance(inputs, Clamped) else inputs


def with_steps(inputs: Any, step_scale: Any) -> Any:
    """The same inputs with other steps of the random walk."""
    changed = body_inputs(inputs)._replace(step_scale=step_scale)
    return inputs._replace(inputs=changed) if isinstance(inputs, Clamped) else changed


def pose_problem(scene: Scene, params: Mapping[str, float] | None = None, start: Start | None = None) -> Problem:
    """Pose the problem of a scene.

    Args:
        scene: The scene.
        params: The programs' params; the body's own if None.
        start: Prior of the first state; around the truth where it is known, else sought in the first frames, if None.

    Raises:
        InputError: The body clamps joints to a truth that is not known.
    """
    body = scene.body
    params = dict(body.params if params is None else params)
    if start is None:
        start = _start(scene, params)
    steps = step_scales(body, params, time_steps(scene.frames, scene.rate))
    return _problem(body, params, scene.cameras, scene.points, scene.noise, start, steps, scene.states)


def _start(scene: Scene, params: Mapping[str, float]) -> Start:
    if scene.states is None:
        return seek_start(scene.body, scene.cameras, scene.points, scene.noise)
    return Start(scene.states[0], step_scales(scene.body, params))


def problem_of_result(tree: xr.DataTree, model: str | None = None) -> Problem:
    """Pose the problem of a tracking result anew, from what the result tells of it.

    Args:
        tree: The result.
        model: Builder of the body; needed where the result's own is not installed, for a file does not choose what is run.

    Raises:
        InputError: The result does not come from `track`, or is of an older layout, or its model is not installed.
    """
    complete = "inputs" in tree.children and "step_scale" in tree["inputs"].dataset
    if not complete or "camera" not in tree.children:
        raise InputError("the result does not tell its inputs", expected="a result of poseppl track of this version")
    inputs = {str(name): np.asarray(values) for name, values in tree["inputs"].dataset.data_vars.items()}
    _, body, params = recorded_model(tree, model)
    seen = {str(name): jnp.asarray(values, float) for name, values in tree["camera"].dataset.data_vars.items()}
    cameras = Cameras(**{name: seen[name] for name in Cameras._fields if name in seen})
    start = Start(inputs["start"], inputs["start_scale"])
    steps = _steps_of_result(inputs, body, params)
    points = np.asarray(tree["observed_data"].dataset["points"].values)
    if np.isnan(points).all():
        raise InputError(
            "the result holds no points: it comes from silhouettes, and their pictures are not in it",
            expected="a result of points; in Python, run_smoother on the silhouette_problem of the scene",
        )
    return _problem(body, params, cameras, points, inputs["noise"], start, steps, inputs.get("states"))


def _steps_of_result(inputs: Mapping[str, Any], body: Body, params: Mapping[str, float]) -> Floats:
    """The recorded steps (T, d); those of clamped coordinates, which nothing depends on, are the published ones."""
    free = np.asarray(inputs["step_scale"], np.float64)
    steps = np.tile(step_scales(body, params), (len(free), 1))
    steps[:, list(body.free_coordinates)] = free
    return steps


def _problem(
    body: Body,
    params: Mapping[str, float],
    cameras: Cameras,
    points: Any,
    noise: Any,
    start: Start,
    steps: Floats,
    states: Any,
) -> Problem:
    spread: Any = jnp.asarray(noise, float)
    fixed: Any = Constant
    inputs = BodyInputs(
        fixed(cameras),
        spread if np.ndim(noise) == 3 else fixed(spread),
        fixed(jnp.asarray(start.mean, float)),
        fixed(jnp.asarray(start.scale, float)),
        jnp.asarray(steps, float),
        fixed(body.tree),
    )
    model = body.compile(frame_inputs(inputs, 0), params)
    observations = model.observe({"points": points})
    if body.free is None:
        return Problem(body, model, observations, inputs)
    if states is None:
        raise InputError("the body clamps joints to a truth that is not known", field="--model")
    whole = Clamped.of_trajectory(jnp.asarray(states, float), inputs)
    return Problem(body, model.clamp(body.free_coordinates), observations, whole)
