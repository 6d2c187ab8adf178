"""Superquadric ellipsoids with tapering and bending on the links of a kinematic tree: flesh of Sminchisescu and Triggs 2001.

A part is a deformed superquadric (section 2; Barr 1984, doi:10.1145/800031.808573), with nine parameters of its shape. With
half-axes a, b, c and exponents e_1 (along z) and e_2 (across), a node at latitude eta and longitude omega is, in its own frame,

    x = a C(eta, e_1) C(omega, e_2),   y = b C(eta, e_1) S(omega, e_2),   z = c S(eta, e_1),

with (C, S) a point of the superellipse |C|^(2/e) + |S|^(2/e) = 1. It is tapered along z, then bent to an arc of a circle:

    x <- (1 + t_x z / c) x,   y <- (1 + t_y z / c) y,
    r <- r + (1 - k r) (1 - cos k z) / k,   z <- (1 - k r) sin(k z) / k,

r being the coordinate along the direction of bending and k the curvature: sections across the part stay plane and rigid.
Exponents of 1 make ellipsoids, towards 0 boxes and cylinders, 2 diamonds. Normals n go as J^-T n, J being the deformation's
Jacobian.

Angles here are not quite Barr's, whose cosines are raised to e and whose nodes crowd into the corners of boxes: C and S go as
cos^sqrt(e) and sin^sqrt(e), scaled onto the superellipse. The surface is the same, and for ellipsoids the angles are.

>>> from poseppl.motion.geometry import Joint, Marker, kinematic_tree
>>> tree = kinematic_tree([Joint("hip", None, (0, 0, 0), "X")], [Marker("knee", "hip", (0, 0, -400))])
>>> flesh = superquadrics_of(tree, [Superquadric("thigh", "hip", (80.0, 70.0, 220.0), taper=(0.2, 0.2), centre=(0, 0, -200))])
>>> poles = surface_nodes(tree, flesh, jnp.zeros(tree.dimension), jnp.array([-0.5, 0.5]) * jnp.pi, jnp.zeros(1)).points
>>> poles[0, :, 0].round().tolist()
[[0.0, 0.0, -420.0], [0.0, 0.0, 20.0]]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.motion.geometry.batch_last import batch_last
from poseppl.motion.geometry.flesh import axes_of, links_of
from poseppl.motion.geometry.kinematics import Frames, frames_of
from poseppl.motion.geometry.tree import KinematicTree

Triple = tuple[float, float, float]
Vector = tuple[Array, Array, Array]

_MIN_EXPONENT = 0.1
_MIN = 1e-6
"""Sines and cosines nearer to 0 than this count as this, so that powers have gradients."""


class Superquadric(NamedTuple):
    """A tapered and bent superquadric ellipsoid.

    Attributes:
        name: Its name.
        joint: The joint in whose frame it is fixed.
        half_axes: Along its own x, y and z before it is deformed, mm.
        exponents: e_1, of its profile along z, and e_2, of its sections across; from 0.1 to 2.
        taper: How much wider along x, and along y, it is at its upper end than in the middle, as a fraction; above -1, below 1.
        bend: Angle between its two ends, radians.
        bend_towards: Direction of its own x and y towards which both ends bend, radians from x.
        centre: Its centre, in the joint's frame, mm.
        axis: Direction of its own z in the joint's frame, of any length.
        across: Direction in the joint's frame near which its own x lies.
    """

    name: str
    joint: str
    half_axes: Triple
    exponents: tuple[float, float] = (1.0, 1.0)
    taper: tuple[float, float] = (0.0, 0.0)
    bend: float = 0.0
    bend_towards: float = 0.0
    centre: Triple = (0.0, 0.0, 0.0)
    axis: Triple = (0.0, 0.0, 1.0)
    across: Triple = (1.0, 0.0, 0.0)


@dataclass(frozen=True)
class Superquadrics:
    """Parts laid out for evaluation.

    Attributes:
        rotations: From each part's frame to its link's (P, 3, 3).
        centres: In the links' frames (P, 3), mm.
        half_axes: Shape (P, 3), mm.
        exponents: Along z and across (P, 2).
        tapers: Along x and y (P, 2).
        bends: Angles, and directions towards which (P, 2), radians.
        links: The link of each part.
        names: Names of the parts.
        pieces: Into how many nearly convex pieces silhouettes cut each part along its z.
    """

    rotations: Array
    centres: Array
    half_axes: Array
    exponents: Array
    tapers: Array
    bends: Array
    links: tuple[int, ...]
    names: tuple[str, ...]
    pieces: int


_STATIC = ["links", "names", "pieces"]
jax.tree_util.register_dataclass(
    Superquadrics, [field.name for field in fields(Superquadrics) if field.name not in _STATIC], _STATIC
)


class Nodes(NamedTuple):
    """Nodes of surfaces: ``points`` (P, R, W, 3, ...) mm, and outward unit ``normals`` of the same shape."""

    points: Array
    normals: Array


def superquadrics_of(tree: KinematicTree, parts: Sequence[Superquadric], *, pieces: int | None = None) -> Superquadrics:
    """Lay out the parts of a body.

    Args:
        tree: The body.
        parts: Its parts.
        pieces: Into how many pieces silhouettes cut each part; if None, as many as the most bent part needs
            (:func:`pieces_needed`).

    Raises:
        ValueError: An unknown joint, two parts of one name, an x along the axis, no piece, or a shape that is none: sizes that
            are not positive, exponents or tapers out of range, or bent so much that the part runs through itself.
    """
    links = links_of(tree, parts)
    for part in parts:
        _check(part)
    needed = max(map(pieces_needed, parts)) if pieces is None else pieces
    if needed < 1:
        raise ValueError(f"{needed} pieces a part; expected at least 1")
    return Superquadrics(
        rotations=jnp.asarray(np.stack([axes_of(part.axis, part.across) for part in parts]), float),
        centres=jnp.asarray([part.centre for part in parts], float),
        half_axes=jnp.asarray([part.half_axes for part in parts], float),
        exponents=jnp.asarray([part.exponents for part in parts], float),
        tapers=jnp.asarray([part.taper for part in parts], float),
        bends=jnp.asarray([(part.bend, part.bend_towards) for part in parts], float),
        links=links,
        names=tuple(part.name for part in parts),
        pieces=needed,
    )


def pieces_needed(part: Superquadric, loss: float = 0.003) -> int:
    """The number of pieces of a part whose convex hulls make its silhouette.

    The hull of an arc of length l and angle g fills a segment of the circle on the hollow side, of area l^2 g / 12; the n
    pieces of a part of length L, angle B and width w add B L / (12 w n^2) of its area, seen from where the bend shows.

    Args:
        part: The part.
        loss: The greatest fraction of the area that may be added so.
    """
    ratio = part.half_axes[2] / min(part.half_axes[:2])
    tapered = 2 if max(map(abs, part.taper)) > 0.1 and part.exponents[0] > 1 else 1  # such a profile is hollow, too
    return max(tapered, int(np.ceil(np.sqrt(abs(part.bend) * ratio / (12 * loss)))))


def surface_nodes(tree: KinematicTree, flesh: Superquadrics, state: Array, latitudes: Array, longitudes: Array) -> Nodes:
    """Nodes of one state (d,) in the world; for gradients in reverse take :func:`nodes_of`, this has none.

    Args:
        tree: The body.
        flesh: Its parts.
        state: Coordinates.
        latitudes: R angles from -pi/2 to pi/2.
        longitudes: W angles.
    """
    nodes: Nodes = batch_last(lambda *arguments: nodes_of(*arguments))(tree, flesh, state, latitudes, longitudes)
    return nodes


def nodes_of(tree: KinematicTree, flesh: Superquadrics, state: Array, latitudes: Array, longitudes: Array) -> Nodes:
    """Nodes (P, R, W, 3, N) of states (d, N), the batch last; other leaves have a last axis of N or 1, angles may have none."""
    return place_nodes(flesh, frames_of(tree, state), local_nodes(flesh, latitudes, longitudes))


def place_nodes(flesh: Superquadrics, frames: Frames, nodes: Nodes) -> Nodes:
    """Nodes in the given frames of links, the batch last."""
    return place_in(*part_axes(flesh, frames), nodes)


def part_axes(flesh: Superquadrics, frames: Frames) -> tuple[Array, Array]:
    """The parts' axes as columns (P, 3, 3, N) and their centres (P, 3, N), mm, in the world, for the given frames of links."""
    link = np.array(flesh.links)
    turn = frames.rotation[link]
    axes = jnp.asarray(sum(turn[:, :, k, None] * flesh.rotations[:, None, k] for k in range(3)))
    return axes, frames.origin[link] + jnp.sum(turn * flesh.centres[:, None], 2)


def place_in(axes: Array, centres: Array, nodes: Nodes) -> Nodes:
    """Nodes of parts with such axes (P, 3, 3, N) and centres (P, 3, N) in the world."""
    points, normals = (_turned(axes, vectors) for vectors in nodes)
    return Nodes(points + centres[:, None, None], normals)


def local_nodes(flesh: Superquadrics, latitudes: Array, longitudes: Array) -> Nodes:
    """Nodes in the parts' frames (P, R, W, 3, N or 1), tapered and bent.

    Args:
        flesh: The parts, leaves (P, ..., N or 1).
        latitudes: R angles, shape (R,) or (R, N or 1).
        longitudes: W angles, shape (W,) or (W, N or 1).
    """
    eta = latitudes.reshape(1, latitudes.shape[0], 1, -1)
    return nodes_at(flesh, eta, longitudes.reshape(1, 1, longitudes.shape[0], -1))


def nodes_at(flesh: Superquadrics, eta: Array, omega: Array) -> Nodes:
    """Nodes in the parts' frames (P, R, W, 3, N or 1) at latitudes and longitudes that differ from part to part.

    Args:
        flesh: The parts, leaves (P, ..., N or 1).
        eta: Latitudes, of a shape that broadcasts to (P, R, W, N).
        omega: Longitudes, likewise.
    """
    along, around = (flesh.exponents[:, i, None, None] for i in range(2))
    (level, height), (x, y) = _superellipse(eta, along), _superellipse(omega, around)
    a, b, c = (flesh.half_axes[:, i, None, None] for i in range(3))
    steep = _slope(level, along)
    slopes = steep * _slope(x, around) / a, steep * _slope(y, around) / b, _slope(height, along) / c
    deformed = _bent(flesh, *_tapered(flesh, (a * level * x, b * level * y, c * height), slopes))
    points, normals = (jnp.stack(jnp.broadcast_arrays(*vector), 3) for vector in deformed)
    return Nodes(points, normals * jax.lax.rsqrt(jnp.sum(normals**2, 3, keepdims=True)))


def _superellipse(angle: Array, exponent: Array) -> tuple[Array, Array]:
    """Its point (C, S) at an angle; see the module's head."""
    root = jnp.sqrt(exponent)
    c, s = jnp.cos(angle), jnp.sin(angle)
    size_c, size_s = (jnp.maximum(jnp.abs(each), _MIN) for each in (c, s))
    norm = (size_c ** (2 / root) + size_s ** (2 / root)) ** (exponent / 2)
    one, other = (
        jnp.where(jnp.abs(each) > _MIN, jnp.sign(each) * size**root / norm, 0.0) for each, size in ((c, size_c), (s, size_s))
    )
    return one, other


def _slope(coordinate: Array, exponent: Array) -> Array:
    """Its part in the gradient of |C|^(2/e) + |S|^(2/e), up to a factor: sign(C) |C|^(2/e - 1)."""
    return jnp.sign(coordinate) * jnp.maximum(jnp.abs(coordinate), _MIN) ** (2 / exponent - 1)


def _tapered(flesh: Superquadrics, place: Vector, normal: Vector) -> tuple[Vector, Vector]:
    """Taper coordinates (P, R, W, N), and the normals there, of any length."""
    (x, y, z), (along_x, along_y, along_z) = place, normal
    steep_x, steep_y = (flesh.tapers[:, i, None, None] / flesh.half_axes[:, 2, None, None] for i in range(2))
    wide_x, wide_y = 1 + steep_x * z, 1 + steep_y * z
    along_x, along_y = along_x / wide_x, along_y / wide_y
    return (wide_x * x, wide_y * y, z), (along_x, along_y, along_z - steep_x * x * along_x - steep_y * y * along_y)


def _bent(flesh: Superquadrics, place: Vector, normal: Vector) -> tuple[Vector, Vector]:
    """Bend coordinates (P, R, W, N), and turn the normals there, of any length.

    With ``left = 1 - k r`` the Jacobian stretches z by it and turns by the angle k z towards which the part bends.
    """
    (x, y, z), (along_x, along_y, along_z) = place, normal
    towards = flesh.bends[:, 1, None, None]
    curvature = flesh.bends[:, 0, None, None] / (2 * flesh.half_axes[:, 2, None, None])
    cosine, sine = jnp.cos(towards), jnp.sin(towards)
    left, turn = 1 - curvature * (cosine * x + sine * y), curvature * z
    # (1 - cos kz) / k and sin(kz) / k, for k = 0 too
    aside, height = left * z * turn / 2 * jnp.sinc(turn / (2 * jnp.pi)) ** 2, left * z * jnp.sinc(turn / jnp.pi)
    along_r, upright = cosine * along_x + sine * along_y, along_z / left
    added = along_r * (jnp.cos(turn) - 1) + upright * jnp.sin(turn)
    turned = along_x + cosine * added, along_y + sine * added, upright * jnp.cos(turn) - along_r * jnp.sin(turn)
    return (x + cosine * aside, y + sine * aside, height), turned


def _turned(axes: Array, vectors: Array) -> Array:
    """Vectors (P, R, W, 3, N) of the parts' frames in the world."""
    return jnp.asarray(sum(axes[:, None, None, :, k] * vectors[:, :, :, k, None] for k in range(3)))


def _check(part: Superquadric) -> None:
    name = f"part {part.name!r}"
    if not (min(part.half_axes) > 0 and np.all(np.isfinite(part.half_axes))):
        raise ValueError(f"{name} has half-axes {part.half_axes}; expected three sizes in mm")
    if not (min(part.exponents) >= _MIN_EXPONENT and max(part.exponents) <= 2):
        raise ValueError(f"{name} has exponents {part.exponents}; expected {_MIN_EXPONENT} to 2")
    if not max(map(abs, part.taper)) < 1:
        raise ValueError(f"{name} has a taper of {part.taper}; expected more than -1, less than 1")
    widest = [half * (1 + abs(taper)) for half, taper in zip(part.half_axes, part.taper, strict=False)]
    reach = abs(np.cos(part.bend_towards)) * widest[0] + abs(np.sin(part.bend_towards)) * widest[1]
    most = min(np.pi, 2 * part.half_axes[2] / reach)
    if not (abs(part.bend) < most and np.isfinite(part.bend_towards)):
        raise ValueError(f"{name} is bent by {part.bend:g} rad; as long and wide as it is, expected less than {most:.3g}")
