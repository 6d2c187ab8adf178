"""A learned activity as the prior of a tracker, in place of the body's random walk.

The learned angles do what the activity does, and stay from it as far as recordings did; the free coordinates walk, with twice
the steps of the recordings. Beside the activity there is other motion, in which all angles do so around their mean, and the
data tell which of the two holds: the result has the probability of the activity, ``prior_mean`` of its summary. The programs
are those of ``poseppl_models.bodies.learned_motion``, found by name.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from poseppl_models.bodies.learned_motion import seen_activity

from poseppl.errors import Argument, FilePath, InputError, Phrase
from poseppl.motion.bodies.body import BodyInputs, compile_once
from poseppl.motion.learned import MotionModel, frames_between, read_motion_model
from poseppl.motion.tracking.problem import Problem, with_steps
from poseppl.motion.tracking.scene import Scene, SceneData
from poseppl.motion.tracking.walk import ASSUMED_RATE
from poseppl.program import CompiledModel
from poseppl.program.memoized_builder import memoized_builder
from poseppl.runs.run import Constant, frame_inputs

STEPS = 2.0
"""Steps of a random walk, in units of the root mean square of recorded ones (our choice): the tracked person may move
faster."""
SILHOUETTE_NOISE = 200.0
"""Standard deviation (mm) of a silhouette's distances with a learned prior, more than without; chosen by the coverage for the
walks of studies/learned_prior.py in one camera."""


def with_prior(problem: Problem, scene: Scene[SceneData], path: FilePath, *, other_motion: bool = True) -> Problem:
    """Give a problem a learned activity as its prior.

    Args:
        problem: The problem of the scene.
        scene: The scene; silhouettes should have a noise of :data:`SILHOUETTE_NOISE`.
        path: File of the activity.
        other_motion: Whether the motion may be another one, too.

    Raises:
        InputError: The file holds none, or one of another body or rate; frames are missing; or the scene is of a detector's
            keypoints.
    """
    model = read_motion_model(path)
    body, own = problem.body, problem.inputs
    if not isinstance(own, BodyInputs):
        expected = "a scene of points or silhouettes"
        raise InputError("a learned prior is for a whole body", field=Argument("prior"), expected=expected)
    shown = own.seen is not None
    if model.coordinates != body.tree.coordinate_names:
        other = Phrase("an activity that poseppl fit-motion has learned with this body (", Argument("model"), ")")
        expected = other if shown else f"{model.body}, or {other}"
        raise InputError(f"it was learned with the body {model.body}", file=path, field=Argument("model"), expected=expected)
    if len(set(np.diff(scene.frames).tolist())) > 1:
        raise InputError("frames are missing between others", field=Argument("prior"), expected="frames at equal distances")
    every = _every(model, scene.rate, path)
    build: Any = seen_activity
    steps = STEPS * every * np.maximum(model.step_scale, 1e-6)
    own_start = _value(own.start), _value(own.start_scale)
    seen = build(model, body.tree.coordinates, every, *own_start, steps if other_motion else None, silhouettes=shown)
    walks = np.where(np.isin(np.arange(len(steps)), model.learned), 0.0, steps)  # learned angles do not walk
    walked = with_steps(own, jnp.asarray(np.tile(walks, (len(scene.frames), 1)), float))
    inputs = walked._replace(activity=Constant(seen.activity))
    compiled = compile_once(seen.program, frame_inputs(inputs, 0))
    pose, follows = (_of_states(compiled, of_sites) for of_sites in (seen.pose, seen.follows))
    return Problem(body, compiled, scene.data.observe(compiled), inputs, pose, follows if other_motion else None)


@memoized_builder
def _of_states(model: CompiledModel, of_sites: Any) -> Callable[[Array, Any], Array]:
    def value(x: Array, inputs: Any) -> Array:
        found: Array = of_sites(model.to_sites(x), inputs.activity)
        return found

    return value


def _every(model: MotionModel, rate: float | None, path: FilePath) -> int:
    try:
        return frames_between(model.rate, ASSUMED_RATE if rate is None else rate, str(path))
    except InputError as error:
        problem = f"it is of {model.rate:g} frames a second, the scene of {rate:g}"
        raise InputError(problem, file=path, expected="a rate that is a whole multiple of the scene's") from error


def _value(leaf: Any) -> Any:
    return leaf.value if isinstance(leaf, Constant) else leaf[0]
