"""A body under observation: what the command line needs to know of a model, and no more.

A model is named by a string, ``package.module:builder`` or ``path/to/file.py:builder``. The builder takes ``lengths``, a
mapping of segment names to mm or None for a standard subject, and returns a :class:`Body`.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax

from poseppl.distributions import SilhouetteSeen
from poseppl.errors import InputError
from poseppl.geometry import Cameras, KinematicTree
from poseppl.program import StateSpaceModel


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
        params: The programs' params. ``sigma_position`` (mm) and ``sigma_angle`` (radians), each a root of a second, are the
            scales that ``step_scale`` of the inputs is made of; the command line may override them.
        noise: Standard deviation of the image noise at focal length 1.
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

    @property
    def free_coordinates(self) -> tuple[int, ...]:
        """Indices of the coordinates that are tracked."""
        joints = [joint for joint, _ in self.tree.coordinates]
        return tuple(i for i, joint in enumerate(joints) if self.free is None or joint in self.free)


class BodyInputs(NamedTuple):
    """Inputs of a body's programs at one frame.

    Attributes:
        cameras: C cameras.
        noise: Standard deviation of the image noise (C, markers), in image units.
        start: Mean of the first state (d,).
        start_scale: Its standard deviations (d,).
        step_scale: Standard deviations of the random walk's step from the frame before to this one (d,), mm and radians.
    """

    cameras: Cameras
    noise: jax.Array
    start: jax.Array
    start_scale: jax.Array
    step_scale: jax.Array


class SilhouetteInputs(NamedTuple):
    """Inputs of the programs of a body that is seen as silhouettes, at one frame; its data site is ``silhouette``.

    Attributes:
        cameras: C cameras, in pixels.
        seen: Contours and distance maps.
        noise: Standard deviation of the silhouette's distances (C,), px.
        start: Mean of the first state (d,).
        start_scale: Its standard deviations (d,).
        step_scale: Standard deviations of the random walk's step from the frame before to this one (d,), mm and radians.
    """

    cameras: Cameras
    seen: SilhouetteSeen
    noise: jax.Array
    start: jax.Array
    start_scale: jax.Array
    step_scale: jax.Array


def load_builder(name: str) -> Callable[..., Body]:
    """Resolve ``package.module:builder`` or ``file.py:builder``.

    Raises:
        InputError: The name has no colon, or the module or the builder is not found.
    """
    place, colon, attribute = name.rpartition(":")
    if not colon:
        raise InputError(f"{name!r} names no builder", field="--model", expected="package.module:builder or file.py:builder")
    try:
        module = _load_file(Path(place)) if place.endswith(".py") else importlib.import_module(place)
    except ImportError as error:
        raise InputError(f"cannot import {place!r}: {error}", field="--model") from error
    builder = getattr(module, attribute, None)
    if not callable(builder):
        known = sorted(key for key, value in vars(module).items() if callable(value) and not key.startswith("_"))
        raise InputError(f"{place} has no builder {attribute!r}", field="--model", expected=f"one of {', '.join(known)}")
    found: Callable[..., Body] = builder
    return found


def _load_file(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None or not path.is_file():
        raise ImportError(f"no such file: {path}")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
