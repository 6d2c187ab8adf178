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

from poseppl.arrays import Floats
from poseppl.errors import InputError
from poseppl.motion.bodies.body import Body
from poseppl.motion.geometry import Cameras, project
from poseppl.motion.tracking.point_data import PointData
from poseppl.motion.tracking.recorded_model import recorded_model
from poseppl.motion.tracking.scene import Scene, SceneData
from poseppl.motion.tracking.start import start_scales
from poseppl.motion.tracking.walk import step_scales, time_steps
from poseppl.program import Clamped, CompiledModel, Observation
from poseppl.program.built_once import built_once
from poseppl.runs.collectors import collect_draws
from poseppl.runs.contents import arrays_of
from poseppl.runs.frame_sequence import rows_of_inputs
from poseppl.runs.run import Collect, Constant, frame_inputs


class Problem(NamedTuple):
    """The inference problem of a scene.

    Attributes:
        body: The body.
        model: Its compiled model; of the free coordinates alone, where the others are clamped.
        observations: The scene's data with a leading T.
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
        seen = rows_of_inputs(self.inputs, frames)
        own = body_inputs(seen)
        record = {"noise": own.noise, "start": own.start, "start_scale": own.start_scale}
        record["step_scale"] = own.step_scale[:, list(self.body.free_coordinates)]
        if self.body.free is not None:
            record["states"] = seen.values
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


def make_problem(scene: Scene[SceneData], params: Mapping[str, float] | None = None, start: Floats | None = None) -> Problem:
    """Pose the problem of a scene.

    Args:
        scene: The scene.
        params: The programs' params; the body's own if None.
        start: State (d,) that the first one is a step of the random walk from; the truth where it is known if None. Where it
            is not, the first state is sought in the data, and less is known of it.

    Raises:
        InputError: The body clamps joints to a truth that is not known, or nothing in the data tells of a start.
    """
    body = scene.body
    params = dict(body.params if params is None else params)
    known = scene.states[0] if start is None and scene.states is not None else start
    if known is None:
        mean, scale = scene.data.seek(scene, params), start_scales(body)
    else:
        mean, scale = known, step_scales(body, params)
    steps = step_scales(body, params, time_steps(scene.frames, scene.rate))
    return _problem(body, params, scene.data, _walk(body, scene.cameras, mean, scale, steps), scene.states)


def problem_of_result(tree: xr.DataTree, model: str | None = None) -> Problem:
    """Pose the problem of a tracking result anew, from what the result tells of it.

    Args:
        tree: The result.
        model: Builder of the body; needed where the result's own is not installed, for a file does not choose what is run.

    Raises:
        InputError: The result does not come from `track`, or is of an older layout, or its model is not installed.
    """
    inputs, calibration = arrays_of(tree, "inputs"), arrays_of(tree, "camera")
    if "step_scale" not in inputs or not calibration:
        raise InputError("the result does not tell its inputs", expected="a result of poseppl track of this version")
    _, body, params = recorded_model(tree, model)
    cameras = Cameras(**{name: jnp.asarray(calibration[name], float) for name in Cameras._fields if name in calibration})
    walk = _walk(body, cameras, inputs["start"], inputs["start_scale"], _steps_of_result(inputs, body, params))
    points = np.asarray(tree["observed_data"].dataset["points"].values)
    if np.isnan(points).all():
        raise InputError(
            "the result holds no points: it comes from silhouettes, and their pictures are not in it",
            expected="a result of points; in Python, run_smoother on the make_problem of the scene",
        )
    return _problem(body, params, PointData(points, inputs["noise"]), walk, inputs.get("states"))


def _steps_of_result(inputs: Mapping[str, Any], body: Body, params: Mapping[str, float]) -> Floats:
    """The recorded steps (T, d); those of clamped coordinates, which nothing depends on, are the published ones."""
    free = np.asarray(inputs["step_scale"], np.float64)
    steps = np.tile(step_scales(body, params), (len(free), 1))
    steps[:, list(body.free_coordinates)] = free
    return steps


def _walk(body: Body, cameras: Cameras, start: Any, start_scale: Any, steps: Floats) -> dict[str, Any]:
    """Inputs by name that do not depend on what was seen."""
    return {
        "cameras": Constant(cameras),
        "start": Constant(jnp.asarray(start, float)),
        "start_scale": Constant(jnp.asarray(start_scale, float)),
        "step_scale": jnp.asarray(steps, float),
        "tree": Constant(body.tree),
    }


def _problem(body: Body, params: Mapping[str, float], data: SceneData, walk: Mapping[str, Any], states: Any) -> Problem:
    inputs = data.inputs(body, walk)
    model = body.compile(frame_inputs(inputs, 0), params)
    observations = data.observe(model)
    if body.free is None:
        return Problem(body, model, observations, inputs)
    if states is None:
        raise InputError("the body clamps joints to a truth that is not known", field="--model")
    whole = Clamped.of_trajectory(jnp.asarray(states, float), inputs)
    return Problem(body, model.clamp(body.free_coordinates), observations, whole)
