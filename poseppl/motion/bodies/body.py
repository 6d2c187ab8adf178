"""A body under observation: what the command line needs to know of a model, and no more.

A model is named by a string, ``package.module:builder`` or ``path/to/file.py:builder``, or by its name in an entry point of the
group ``poseppl.models``. The builder takes ``lengths``, a mapping of segment names to mm or None for a standard subject. It
returns a :class:`Body`.

To import is to run code. So :func:`body_builder` is for names that the user gives, and
:func:`poseppl.motion.tracking.recorded_model.installed_builder` for names that are found in files.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from functools import lru_cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.arrays import Floats
from poseppl.errors import Argument, InputError, brief
from poseppl.files.user_code import import_named
from poseppl.motion.geometry import Cameras, KinematicTree, marker_positions
from poseppl.motion.geometry.flesh import Flesh
from poseppl.motion.io.text_parsing import some
from poseppl.program import CompiledModel, StateSpaceModel

_GROUP = "poseppl.models"
_BUILDER = "a function of segment lengths (None for those of a standard subject) that returns a Body"


class Body(NamedTuple):
    """A body model and how recordings map onto it.

    Attributes:
        program: The NumPyro programs; their inputs are :class:`BodyInputs`, their data site is ``points`` (C, markers, 2).
        tree: The kinematic tree; its coordinates are the program's flat state, in the same order.
        edges: Pairs of marker names, to draw a stick figure.
        root: The marker that errors are taken relative to.
        aliases: For each marker, the joint names that recordings use for the same place.
        lengths: Segment lengths in mm.
        measure: Recorded marker positions by name, each (T, 3) mm, to ``lengths``.
        free: Names of the joints that are tracked, the rest being clamped to the truth; None tracks all.
        rest: State of the rest pose (d,): standing at the origin.
        params: The programs' params. ``sigma_position`` (mm) and ``sigma_angle`` (radians), each per square root of a second,
            are the scales that ``step_scale`` of the inputs is made of; the command line may override them.
        noise: Standard deviation of the image noise at focal length 1.
        flesh: The parts that its silhouette consists of; None for a body of points alone.
        segments: Joints by the segments of OpenSim's bodies that turn with them (:mod:`poseppl.motion.bodies.opensim`), where a
            joint's frame is the segment's: x to the right, y forward, z up in a person who stands with straight limbs.
        postures: Mean and standard deviation (radians) of angles in recordings of people, by joint and axis.
    """

    program: StateSpaceModel
    tree: KinematicTree
    edges: tuple[tuple[str, str], ...]
    root: str
    aliases: Mapping[str, tuple[str, ...]]
    lengths: Mapping[str, float]
    measure: Callable[[Mapping[str, Any]], Mapping[str, float]]
    free: tuple[str, ...] | None
    rest: Any
    params: Mapping[str, float]
    noise: float
    flesh: Flesh | None = None
    segments: Mapping[str, str] = {}
    postures: Mapping[tuple[str, str], tuple[float, float]] = {}

    def compile(self, inputs: Any, params: Mapping[str, float]) -> CompiledModel:
        """Compile the programs.

        Args:
            inputs: The inputs of one frame.
            params: The programs' params.

        Returns:
            The compiled model; the same one for all bodies of these programs and inputs of the same shapes, so that what was
            compiled for one person's recording serves the next.

        Raises:
            InputError: A program fails.
        """
        try:
            return compile_once(self.program, inputs, params)
        except ValueError as error:
            raise InputError(str(error), field=Argument("model")) from error

    def places(self, states: Any) -> Floats:
        """Positions (T, K, 3) of the markers in states (T, d), mm."""
        of_state: Any = jax.vmap(lambda state: marker_positions(self.tree, state))
        return np.asarray(of_state(jnp.asarray(states)), np.float64)

    @property
    def free_coordinates(self) -> tuple[int, ...]:
        """Indices of the coordinates that are tracked."""
        joints = [joint for joint, _ in self.tree.coordinates]
        return tuple(i for i, joint in enumerate(joints) if self.free is None or joint in self.free)


def compile_once(program: StateSpaceModel, inputs: Any, params: Mapping[str, float] | None = None) -> CompiledModel:
    """The compiled programs; the same ones for the same programs, inputs of the same shapes and equal params."""
    leaves, tree = jax.tree.flatten(jax.eval_shape(lambda values: values, inputs))
    return _compiled(program, tree, tuple(leaves), None if params is None else tuple(sorted(params.items())))


@lru_cache(maxsize=8)
def _compiled(program: StateSpaceModel, tree: Any, shapes: tuple[Any, ...], params: tuple[Any, ...] | None) -> CompiledModel:
    return program.compile(jax.tree.unflatten(tree, shapes), None if params is None else dict(params))


class Posture(NamedTuple):
    """How people hold themselves: to its angles a mean-reverting walk comes back, N(mean + kept (x - mean), step_scale^2).

    Attributes:
        mean: Angles (d,), radians.
        kept: Share of the distance from them that remains from the previous frame (d,); 1 in a random walk.
    """

    mean: Any
    kept: Any


class Velocities(NamedTuple):
    """Velocities that a walk goes along: N(x + step (v + v'), step_scale^2), from v to v' ~ N(kept v, (1 - kept^2) scale^2).

    Attributes:
        scale: Their standard deviations (d,), mm and radians a second.
        kept: Share of them that remains from the previous frame ().
        step: Seconds () that each of both is gone along.
    """

    scale: Any
    kept: Any
    step: Any


class LastingErrors(NamedTuple):
    """Errors of points that last from frame to frame, at one frame; ``poseppl_models.bodies.detected_points`` has the programs.

    Attributes:
        shift_scale: Standard deviation () of a marker's place beside its joint, mm.
        shift_kept: a, what is left of it () from the frame before.
        error_share: r^2 (), share of the autocorrelated errors in the variance.
        error_kept: b, what is left of them () from the frame before.
        length_root: S, lower triangular (L, L), whose S S^T is the covariance of the lengths' errors, mm.
        per_length: How the tree's offsets change with each of L lengths, these with a leading L; None for exact lengths.
        camera_root: R, lower triangular (6 C, 6 C): turns, radians, and shift of the centre, mm, of one camera after the other.
    """

    shift_scale: Any
    shift_kept: Any
    error_share: Any
    error_kept: Any
    length_root: Any
    per_length: Any
    camera_root: Any


class BodyInputs(NamedTuple):
    """Inputs of a body's programs at one frame; its data site is ``points``, or ``silhouette`` where that is seen.

    Attributes:
        cameras: C cameras; of silhouettes in pixels.
        noise: Standard deviation of the image noise (C, markers), in image units; of a silhouette's distances (C,), px; or what
            else a model knows of it.
        start: Mean of the first state (d,).
        start_scale: Its standard deviations (d,).
        step_scale: Standard deviations of the random walk's step from the frame before to this one (d,), mm and radians.
        tree: The person's own tree: offsets are arguments of the programs, so that all people share one compiled program.
        activity: Programs of a learned prior in place of the random walk.
        seen: Contours and distance maps of the silhouettes, or what else is seen of pictures; None of points.
        flesh: The person's own, of pictures.
        errors: Those of points that last; None where each frame has its own.
        posture: Mean to which the walk reverts; None if all coordinates are random walks.
        velocities: Along which it goes; None where its steps are independent.
        seconds: Since the frame before (), for a learned prior of velocities.
    """

    cameras: Cameras
    noise: Any
    start: Array
    start_scale: Array
    step_scale: Array
    tree: KinematicTree
    activity: Any = None
    seen: Any = None
    flesh: Any = None
    errors: Any = None
    posture: Posture | None = None
    velocities: Velocities | None = None
    seconds: Any = None


def load_builder(name: str) -> Callable[..., Any]:
    """Resolve ``package.module:function``, ``file.py:function`` or the name of an entry point, whatever it is; this runs code.

    Raises:
        InputError: The name has no colon and is no entry point, or the module or the function is not found.
    """
    place, colon, attribute = entry_point_builders().get(name, name).rpartition(":")
    if not colon:
        raise InputError(
            f"{brief(name)} names no builder", field=Argument("model"), expected="package.module:builder or file.py:builder"
        )
    module = import_named(place, Argument("model"))
    found: Callable[..., Any] | None = getattr(module, attribute, None)
    if not callable(found):
        known = sorted(key for key, value in vars(module).items() if callable(value) and not key.startswith("_"))
        raise InputError(
            f"{place} has no builder {brief(attribute)}", field=Argument("model"), expected="one of " + some(known, 25)
        )
    return found


def body_builder(name: str) -> Callable[[Mapping[str, float] | None], Body]:
    """Resolve a builder of bodies as :func:`load_builder` does, and see that it builds one.

    Raises:
        InputError: It is not found, raises, or returns something else.
    """
    build = load_builder(name)
    try:
        standard = build(None)
    except Exception as error:  # the builder's own code, too
        problem = f"{name} builds no body: {type(error).__name__}: {error}"
        raise InputError(problem, field=Argument("model"), expected=_BUILDER) from error
    if not isinstance(standard, Body):
        raise InputError(f"{name} returns a {type(standard).__name__}", field=Argument("model"), expected=_BUILDER)
    return build


def name_of_builder(build: Callable[..., Any]) -> str:
    """The name by which :func:`load_builder` finds a builder that is a function of a module."""
    return f"{build.__module__}:{build.__qualname__}"


def source_of_model(name: str) -> str | None:
    """Hash of a user's own model file; None for a model of a package."""
    path = Path(name.rpartition(":")[0])
    if path.suffix != ".py" or not path.is_file():
        return None
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def entry_point_builders() -> dict[str, str]:
    """``package.module:builder`` by the name of the entry point."""
    return {entry.name: entry.value for entry in entry_points(group=_GROUP)}


class PointInputs(NamedTuple):
    """Inputs of the programs at one frame, of K points in C cameras with L links.

    Attributes:
        cameras: The cameras.
        magnification: (C,) pixels that a unit of length has at the points.
        window: (C, 2) width and height of the pictures.
        logit: (C, K) of the detector's confidence.
        elapsed: Seconds () since the frame before.
        freedom: Degrees of freedom () of the errors that do not last.
        start: (K, 3) about where the points are at first.
        start_scale: Standard deviation () of that.
        length: (L,) prior mean of the links' lengths.
        length_scale: (L,) its standard deviation.
        tolerance: (L,) standard deviation of a distance around its length.
    """

    cameras: Any
    magnification: Any
    window: Any
    logit: Any
    elapsed: Any
    freedom: Any
    start: Any
    start_scale: Any
    length: Any
    length_scale: Any
    tolerance: Any
