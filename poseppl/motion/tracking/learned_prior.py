"""A learned motion as the prior of a tracker, in place of the body's random walk.

There are two kinds, by their file. The angles of an activity (:class:`MotionModel`) do what the activity does, and stay from it
as far as recordings did; beside it there is other motion, in which all angles do so around their mean, and the data tell which
of the two holds: the result has the probability of the activity, ``prior_mean`` of its summary. A recorded walk
(:class:`FactoredMotion`) has rotations in bins that follow its phases, each by itself, and knows no other motion. The free
coordinates walk, with twice the steps of the recordings.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
import xarray as xr
from jax import Array
from poseppl_models.bodies.factored_motion import seen_walk
from poseppl_models.bodies.learned_motion import seen_activity

from poseppl.errors import Argument, FilePath, InputError, Phrase
from poseppl.files.bounded_reading import check_file
from poseppl.motion.bodies.body import BodyInputs, compile_once
from poseppl.motion.io.motion import RATE_TOLERANCE
from poseppl.motion.learned import FactoredMotion, MotionModel, frames_between, read_learned_motion, root_places
from poseppl.motion.learned.motion_model import MAX_BYTES
from poseppl.motion.tracking.problem import Problem, points_of_result, walk_of_result, with_steps
from poseppl.motion.tracking.scene import Scene, SceneData
from poseppl.motion.tracking.walk import ASSUMED_RATE
from poseppl.program import CompiledModel
from poseppl.program.memoized_builder import memoized_builder
from poseppl.runs.contents import frame_numbers
from poseppl.runs.results import provenance
from poseppl.runs.run import Constant, frame_inputs

STEPS = 2.0
"""Steps of a random walk, in units of the root mean square of recorded ones (our choice): the tracked person may move
faster."""
SILHOUETTE_NOISE = 200.0
"""Standard deviation (mm) of a silhouette's distances with a learned prior, more than without; chosen by the coverage for the
walks of studies/learned_prior.py in one camera."""


def filter_of(motion: MotionModel | FactoredMotion) -> str:
    """The usual filter of a learned motion: phases of an activity are switched between, those of bins are in particles."""
    return "particle" if isinstance(motion, FactoredMotion) else "switching"


def digest_of(path: FilePath) -> str:
    """Digest of a learned motion's file, by which a result knows its prior again."""
    return hashlib.sha256(check_file(path, max_bytes=MAX_BYTES).read_bytes()).hexdigest()[:16]


def with_prior(problem: Problem, scene: Scene[SceneData], path: FilePath, *, other_motion: bool = True) -> Problem:
    """Give a problem a learned motion as its prior.

    Args:
        problem: The problem of the scene.
        scene: The scene; silhouettes should have a noise of :data:`SILHOUETTE_NOISE`.
        path: File of the motion.
        other_motion: Whether, beside an activity, the motion may be another one.

    Raises:
        InputError: The file holds none, or one of another body or rate; frames are missing; or the scene is of a detector's
            keypoints.
    """
    return _prior_of_frames(problem, scene.data, scene.frames, scene.rate, path, other_motion=other_motion)


def prior_of_result(tree: xr.DataTree, path: FilePath, body: str | None = None) -> Problem:
    """Pose the problem of a result of a learned prior again.

    Args:
        tree: The result.
        path: File of the prior, unchanged.
        body: Builder of the body, as :func:`poseppl.motion.tracking.problem.problem_of_result` takes it.

    Raises:
        InputError: As there, or this is not the prior of the result.
    """
    known = provenance(tree)
    if "prior" not in known:
        raise InputError("the result was tracked without a learned prior", field=Argument("prior"), expected="none")
    if known.get("prior digest") != digest_of(path):
        expected = f"{known['prior']}, as it was then"
        raise InputError("the result was tracked with another prior", file=path, field=Argument("prior"), expected=expected)
    walk, frames, rate = walk_of_result(tree, body), frame_numbers(tree), tree.attrs.get("rate")
    return _prior_of_frames(walk, points_of_result(tree), frames, rate, path, other_motion=known.get("other motion") is True)


def _prior_of_frames(
    problem: Problem, data: SceneData, frames: Any, rate: float | None, path: FilePath, *, other_motion: bool
) -> Problem:
    model = read_learned_motion(path)
    body, own = problem.body, problem.inputs
    if not isinstance(own, BodyInputs):
        expected = "a scene of points or silhouettes"
        raise InputError("a learned prior is for a whole body", field=Argument("prior"), expected=expected)
    shown = own.seen is not None
    if model.coordinates != body.tree.coordinate_names:
        other = Phrase("a motion that poseppl fit-motion has learned with this body (", Argument("model"), ")")
        expected = other if shown else f"{model.body}, or {other}"
        raise InputError(f"it was learned with the body {model.body}", file=path, field=Argument("model"), expected=expected)
    if len(set(np.diff(frames).tolist())) > 1:
        raise InputError("frames are missing between others", field=Argument("prior"), expected="frames at equal distances")
    start = _value(own.start), _value(own.start_scale)
    if isinstance(model, FactoredMotion):
        _check_rate(model, rate, path)
        walks = np.zeros(len(model.coordinates))
        walks[root_places(body.tree.coordinates)] = STEPS * model.step_scale
        own = own._replace(seconds=Constant(jnp.asarray(1 / model.rate, float)))
        seen = seen_walk(model, body.tree.coordinates, *start, silhouettes=shown)
    else:
        every = _every(model, rate, path)
        steps = STEPS * every * np.maximum(model.step_scale, 1e-6)
        walks = np.where(np.isin(np.arange(len(steps)), model.learned), 0.0, steps)  # learned angles do not walk
        seen = seen_activity(model, body.tree.coordinates, every, *start, steps if other_motion else None, silhouettes=shown)
    walked = with_steps(own, jnp.asarray(np.tile(walks, (len(frames), 1)), float))
    inputs = walked._replace(activity=Constant(seen.activity))
    compiled = compile_once(seen.program, frame_inputs(inputs, 0))
    pose = _of_states(compiled, seen.pose)
    follows = None if seen.follows is None else _of_states(compiled, seen.follows)
    return Problem(body, compiled, data.observe(compiled), inputs, pose, follows)


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


def _check_rate(model: FactoredMotion, rate: float | None, path: FilePath) -> None:
    """A row of the tables is a frame: refuse another rate."""
    own = ASSUMED_RATE if rate is None else rate
    if abs(model.rate - own) > RATE_TOLERANCE * own:
        problem = f"its tables are of {model.rate:g} frames a second, the scene of {own:g}"
        raise InputError(problem, file=path, expected=Phrase("a walk learned with ", Argument("rate", f"{own:g}")))


def _value(leaf: Any) -> Any:
    return leaf.value if isinstance(leaf, Constant) else leaf[0]
