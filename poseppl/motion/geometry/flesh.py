"""Bodies with flesh: elliptical truncated cones and spheres that ride on the links of a kinematic tree.

A part has an axis of some length along its own z, from its base at z = 0; across it is an ellipse whose half-axes along x and y
are ``radius * scale``, the radius going linearly from ``radii[0]`` at the base to ``radii[1]`` at the tip. Equal radii make a
cylinder. Its ends are flat, or balls of the ends' radii; a sphere (:func:`sphere`) is a very short one. One layout serves all
published bodies: 10 cones (Darby, Li and Costen 2008), 14 (Du and Guan 2006), cylinders (Peursum, Venkatesh and West 2010).

>>> from poseppl.motion.geometry import Joint, Marker, kinematic_tree
>>> tree = kinematic_tree([Joint("hip", None, (0, 0, 0), "X")], [Marker("knee", "hip", (0, 0, -400))])
>>> flesh = flesh_of(tree, [Cone("thigh", "hip", 400.0, (80.0, 60.0), axis=(0, 0, -1))])
>>> part_frames(tree, flesh, jnp.zeros(tree.dimension)).tip.tolist()
[[0.0, 0.0, -400.0]]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.motion.geometry.batch_last import batch_last
from poseppl.motion.geometry.kinematics import Frames, frames_of
from poseppl.motion.geometry.tree import KinematicTree

Triple = tuple[float, float, float]


class Cone(NamedTuple):
    """An elliptical truncated cone.

    Attributes:
        name: Its name.
        joint: The joint in whose frame it is fixed.
        length: From base to tip, mm; a negative one runs against its own z.
        radii: At the base and at the tip, mm.
        scale: Factors of the radii along the part's own x and y.
        origin: Its base, in the joint's frame, mm.
        axis: Direction of its own z in the joint's frame, of any length.
        across: Direction in the joint's frame near which its own x lies; matters where the factors differ.
        balls: Whether both ends are balls instead of flat; silhouettes know them, sampled outlines do not.
    """

    name: str
    joint: str
    length: float
    radii: tuple[float, float]
    scale: tuple[float, float] = (1.0, 1.0)
    origin: Triple = (0.0, 0.0, 0.0)
    axis: Triple = (0.0, 0.0, 1.0)
    across: Triple = (1.0, 0.0, 0.0)
    balls: bool = False


def sphere(name: str, joint: str, radius: float, centre: Triple = (0.0, 0.0, 0.0)) -> Cone:
    """A sphere of some radius about a point of the joint's frame, mm: two balls a thousandth of the radius apart."""
    length = 1e-3 * radius
    return Cone(name, joint, length, (radius, radius), origin=(centre[0], centre[1], centre[2] - 0.5 * length), balls=True)


@dataclass(frozen=True)
class Flesh:
    """Parts laid out for evaluation.

    Attributes:
        rotations: From each part's frame to its link's (P, 3, 3).
        origins: Bases in the links' frames (P, 3), mm.
        lengths: Shape (P,), mm.
        radii: Base and tip (P, 2), mm.
        scales: Factors along x and y (P, 2).
        balls: 1 where the ends are balls, 0 where they are flat (P,).
        links: The link of each part.
        names: Names of the parts.
    """

    rotations: Array
    origins: Array
    lengths: Array
    radii: Array
    scales: Array
    balls: Array
    links: tuple[int, ...]
    names: tuple[str, ...]


_STATIC = ["links", "names"]
jax.tree_util.register_dataclass(Flesh, [field.name for field in fields(Flesh) if field.name not in _STATIC], _STATIC)


class PartFrames(NamedTuple):
    """Parts in the world: ``base`` and ``tip`` (P, 3, ...) mm, and ``axes`` (P, 3, 3, ...), whose columns are x, y and z."""

    axes: Array
    base: Array
    tip: Array


def flesh_of(tree: KinematicTree, parts: Sequence[Cone]) -> Flesh:
    """Lay out the parts of a body.

    Raises:
        ValueError: An unknown joint, a size that is not positive, two parts of one name, or an x along the axis.
    """
    links = links_of(tree, parts)
    for part in parts:
        _check(part)
    return Flesh(
        rotations=jnp.asarray(np.stack([axes_of(part.axis, part.across) for part in parts]), float),
        origins=jnp.asarray([part.origin for part in parts], float),
        lengths=jnp.asarray([part.length for part in parts], float),
        radii=jnp.asarray([part.radii for part in parts], float),
        scales=jnp.asarray([part.scale for part in parts], float),
        balls=jnp.asarray([part.balls for part in parts], float),
        links=links,
        names=tuple(part.name for part in parts),
    )


class Rider(Protocol):
    """A part of any shape, as far as where it rides goes."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def joint(self) -> str:
        """The joint in whose frame it is fixed."""

    @property
    def axis(self) -> Triple:
        """Direction of its own z."""

    @property
    def across(self) -> Triple:
        """Direction near which its own x lies."""


def links_of(tree: KinematicTree, parts: Sequence[Rider]) -> tuple[int, ...]:
    """The links that parts ride on.

    Raises:
        ValueError: There is no part; an unknown joint, two parts of one name, or an x along the axis.
    """
    if not parts:
        raise ValueError("a body needs at least one part")
    names = [part.name for part in parts]
    for number, part in enumerate(parts):
        if part.joint not in tree.joint_names:
            raise ValueError(f"part {part.name!r} rides on joint {part.joint!r}; expected one of {sorted(tree.joint_names)}")
        if part.name in names[:number]:
            raise ValueError(f"two parts are named {part.name!r}")
        if np.linalg.norm(np.cross(part.axis, part.across)) < 1e-6:
            raise ValueError(f"part {part.name!r} has its x along its axis: axis {part.axis}, across {part.across}")
    last = {joint: link for link, joint in enumerate(tree.link_joint)}  # links are sorted by depth: the last one stays
    return tuple(last[tree.joint_names.index(part.joint)] for part in parts)


def part_frames(tree: KinematicTree, flesh: Flesh, state: Array) -> PartFrames:
    """Parts of one state (d,) in the world; for gradients in reverse take :func:`parts_of`, this has none."""
    frames: PartFrames = batch_last(lambda *arguments: parts_of(*arguments))(tree, flesh, state)
    return frames


def parts_of(tree: KinematicTree, flesh: Flesh, state: Array) -> PartFrames:
    """Parts of states (d, N), the batch last; leaves of ``tree`` and ``flesh`` have a last axis of N or 1."""
    return place_parts(flesh, frames_of(tree, state))


def place_parts(flesh: Flesh, frames: Frames) -> PartFrames:
    """Parts in the given frames of links, the batch last."""
    link = np.array(flesh.links)
    turn = frames.rotation[link]
    axes = sum(turn[:, :, k, None] * flesh.rotations[:, None, k] for k in range(3))
    base = frames.origin[link] + jnp.sum(turn * flesh.origins[:, None], 2)
    return PartFrames(jnp.asarray(axes), base, base + jnp.asarray(axes)[:, :, 2] * flesh.lengths[:, None])


def axes_of(axis: Triple, across: Triple) -> np.ndarray:
    """A part's x, y and z as columns: z along ``axis``, x as near to ``across`` as can be."""
    z = np.array(axis, float) / np.linalg.norm(axis)
    x = np.array(across, float) - z * np.dot(across, z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], 1)


def _check(part: Cone) -> None:
    if not (part.length != 0 and min(part.radii) >= 0 and max(part.radii) > 0 and min(part.scale) > 0):
        raise ValueError(f"part {part.name!r} has length {part.length}, radii {part.radii}, scale {part.scale}; expected sizes")
