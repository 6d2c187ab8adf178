"""Superquadrics in images: nodes that are seen, points of occluding contours, and silhouettes.

A node is seen if its normal leans towards the eye. If that changes along an edge of the mesh, the occluding contour crosses
it, and the crossing is interpolated (:func:`contour_points`). Both know of no other part, nor of another side of the same one.

For silhouettes (:func:`outlines_of`) each part is cut along its z into pieces that are nearly convex: each looks like the
convex hull of its nodes. Nodes of that hull that are extreme in M directions, even for an ellipse of the hull's covariance,
make a polygon. Then each side of the polygon is moved out until it touches the hull. Its distance from the origin is then the
support function h in the direction n of the side. It is moved back by a third of that distance s, so that a smooth outline and
the polygon have the same area:

    d = min over pieces, max over sides of (n . u - h + s / 3)

is the signed distance of an image point u, negative inside, in the image's units; exact beside sides, too small beside corners.
From these distances :func:`poseppl.motion.geometry.coverage.soft_coverage` and ``hard_coverage`` go on as with cones. Lenses
may bend.

A polygon's corner that moves to the next node of the mesh makes distances jump by a fraction of the mesh's own error; gradients
are exact between such moves.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.checks import check_at_least
from poseppl.motion.geometry.cameras import Cameras, project_components
from poseppl.motion.geometry.kinematics import Frames
from poseppl_models.sminchisescu_triggs.superquadrics import Nodes, Superquadrics, local_nodes, place_nodes

_EVEN = 0.75
"""The cuts of parts: at latitudes of so much those of slices of one height, and for the rest even ones."""
_FILL = 1 / 24
"""Nodes are moved out by so much of their second differences: seen from all around, chords fall short of arcs by that."""
_CREASE = 4.0
"""Second differences of so many times a circle's, squared, are creases, where nothing is missing."""
_FLAT = 1e-6
"""Amount added to the smaller spread of a piece, as a fraction of its spread: one seen as a line would have no directions."""
_TINY = 1e-12
_SHORT = 1e-4
"""Sides shorter than this, as a fraction of the spread, have the direction for which their ends were sought."""
_LARGEST_STEP = 0.25
"""Sides are moved back by no more than this, times their length."""


class Fineness(NamedTuple):
    """How finely silhouettes are drawn.

    Attributes:
        rings: Gaps of the mesh from pole to pole, at least; a piece has two.
        meridians: Nodes around a part, an even number.
        sides: Sides of each piece's polygon.
    """

    rings: int = 20
    meridians: int = 28
    sides: int = 28

    def check(self) -> Fineness:
        """Return the settings, or raise ``ValueError`` that names the one that is out of range."""
        check_at_least(2, rings=self.rings)
        check_at_least(4, meridians=self.meridians, sides=self.sides)
        if self.meridians % 2:
            raise ValueError(f"meridians is {self.meridians}; expected an even number")
        return self


class Contours(NamedTuple):
    """Occluding contours where edges of the mesh cross them.

    Attributes:
        points: In the world (C, P, E, 3, N), mm; for E edges each.
        image: In the cameras' images (C, P, E, 2, N), in their units.
        on: 1 where there is a crossing, else 0 (C, P, E, N).
    """

    points: Array
    image: Array
    on: Array


class Outlines(NamedTuple):
    """Silhouettes of S pieces of each part as convex polygons.

    Attributes:
        normals: Outward unit normals of the sides (C, P, S, M, 2, N).
        offsets: Distances of the sides from the origin (C, P, S, M, N).
    """

    normals: Array
    offsets: Array


def facing(cameras: Cameras, nodes: Nodes) -> Array:
    """Cosine (C, P, R, W, N) between nodes' normals and the way to the eye; a node is seen where it is positive."""
    towards = cameras.centre[:, None, None, None] - nodes.points
    towards = towards * jax.lax.rsqrt(jnp.sum(towards**2, 4, keepdims=True))
    return jnp.sum(towards * nodes.normals, 4)


def contour_points(cameras: Cameras, nodes: Nodes) -> Contours:
    """Crossings of the mesh's edges, those along rings first, with the occluding contours.

    Args:
        cameras: C cameras, leaves (C, ..., N or 1).
        nodes: Nodes of the parts (P, R, W, 3, N), longitudes all around.
    """
    lean = facing(cameras, nodes)
    place = jnp.broadcast_to(nodes.points, (lean.shape[0], *nodes.points.shape))
    around = (jnp.roll(lean, -1, 3), jnp.roll(place, -1, 3))
    found = [_crossings(lean, *around, place), _crossings(lean[:, :, :-1], lean[:, :, 1:], place[:, :, 1:], place[:, :, :-1])]
    points, on = (jnp.concatenate(leaves, 2) for leaves in zip(*found, strict=True))
    return Contours(points, _project(cameras, points, 2), on)


def outlines_of(cameras: Cameras, flesh: Superquadrics, frames: Frames, fineness: Fineness | None = None) -> Outlines:
    """Silhouettes of all pieces of all parts in all cameras, batch last.

    Args:
        cameras: C cameras, leaves (C, ..., N or 1).
        flesh: The parts, leaves (P, ..., N or 1).
        frames: Frames of the links, leaves (links, ..., N).
        fineness: Fineness of the mesh and the polygons; the usual one if None.

    Raises:
        ValueError: A setting is out of range.
    """
    fineness = (fineness or Fineness()).check()
    num_sides = fineness.sides
    mesh = local_nodes(flesh, *_angles(flesh.pieces, fineness))
    image = _project(cameras, place_nodes(flesh, frames, mesh._replace(points=_filled(mesh.points))).points, 3)
    steps = (image.shape[2] - 1) // flesh.pieces
    rows = np.arange(flesh.pieces)[:, None] * steps + np.arange(steps + 1)
    nodes = image[:, :, rows].reshape(*image.shape[:2], flesh.pieces, -1, 2, image.shape[-1])  # (C, P, S, V, 2, N)
    spread, root = _spread(nodes)
    corners = _farthest(nodes, _directions(root, num_sides, 0.0))
    sides = jnp.roll(corners, -1, 3) - corners
    length = jnp.sqrt(jnp.sum(sides**2, 4) + (_SHORT * spread[:, :, :, None]) ** 2)
    normals = jnp.stack([sides[..., 1, :], -sides[..., 0, :]], 4)
    normals = normals + (_SHORT * spread)[:, :, :, None, None] * _directions(root, num_sides, 0.5)
    normals = normals * jax.lax.rsqrt(jnp.sum(normals**2, 4, keepdims=True))
    reach = jnp.sum(normals * _farthest(nodes, normals), 4)
    beyond = reach - jnp.sum(normals * corners, 4)
    return Outlines(normals, reach - jnp.minimum(beyond / 3, _LARGEST_STEP * length))


def superquadric_distances(outlines: Outlines, points: Array) -> Array:
    """Signed distances (C, P, K, N) of image points (C, K, 2, N or 1) from every part, negative inside."""
    x, y = (points[:, None, None, None, :, i] for i in range(2))
    across = outlines.normals[:, :, :, :, 0, None] * x + outlines.normals[:, :, :, :, 1, None] * y
    return jnp.min(jnp.max(across - outlines.offsets[:, :, :, :, None], 3), 2)


def _angles(pieces: int, fineness: Fineness) -> tuple[Array, Array]:
    """Latitudes and longitudes of the mesh; every so many latitudes the parts are cut."""
    steps = max(2, int(np.ceil(fineness.rings / pieces)))
    share = np.linspace(-1, 1, pieces + 1)
    cuts = _EVEN * np.arcsin(share) + (1 - _EVEN) * np.pi / 2 * share
    latitudes = np.interp(np.linspace(0, pieces, pieces * steps + 1), np.arange(pieces + 1), cuts)
    return jnp.asarray(latitudes, float), jnp.asarray(np.linspace(0, 2 * np.pi, fineness.meridians, endpoint=False), float)


def _filled(points: Array) -> Array:
    """Move nodes (P, R, W, 3, N) out, so that seen from all around their polyhedron is as large as the surface."""
    rings, meridians = points.shape[1:3]
    over = [jnp.roll(points[:, ring : ring + 1], meridians // 2, 2) for ring in (1, rings - 2)]  # over the poles
    along = _outwards(
        points, jnp.concatenate([over[0], points[:, :-1]], 1), jnp.concatenate([points[:, 1:], over[1]], 1), 2 * rings
    )
    around = _outwards(points, jnp.roll(points, 1, 2), jnp.roll(points, -1, 2), meridians)
    return points + along + around


def _outwards(points: Array, before: Array, after: Array, number: int) -> Array:
    """How far nodes (P, R, W, 3, N) have to be moved out; ``number`` of them make a circle."""
    second, chord = 2 * points - before - after, (after - before) / 2
    turn = jnp.sum(second**2, 3, keepdims=True) / (jnp.sum(chord**2, 3, keepdims=True) + _TINY)  # the squared angle
    return second * (_FILL / (1 + (turn / (_CREASE * (2 * np.pi / number) ** 2)) ** 2))


def _crossings(first: Array, second: Array, end: Array, start: Array) -> tuple[Array, Array]:
    """Zeros of a linear function between ``start`` and ``end``, flattened, and whether there are."""
    on = first * second < 0
    share = jnp.where(on, first, 0.0) / jnp.where(on, first - second, 1.0)
    points = start + share[:, :, :, :, None] * (end - start)
    flat = (*points.shape[:2], -1)
    return points.reshape(*flat, *points.shape[4:]), on.astype(points.dtype).reshape(*flat, on.shape[-1])


def _project(cameras: Cameras, points: Array, inner: int) -> Array:
    """Project points whose ``inner`` axes between the cameras' and the coordinates' are broadcast."""
    shape = (1,) * inner
    spread: Cameras = jax.tree.map(
        lambda leaf: jnp.moveaxis(leaf, 0, -2).reshape(*leaf.shape[1:-1], leaf.shape[0], *shape, leaf.shape[-1]), cameras
    )
    x, y, z = (points[..., i, :] for i in range(3))
    return jnp.stack(project_components(spread, x, y, z), -2)


def _spread(nodes: Array) -> tuple[Array, tuple[Array, ...]]:
    """Square root of the variance of nodes (C, P, S, V, 2, N), (C, P, S, N), and the Cholesky factor of their covariance."""
    offset = nodes - jnp.mean(nodes, 3, keepdims=True)
    x, y = offset[..., 0, :], offset[..., 1, :]
    xx, xy, yy = jnp.mean(x * x, 3), jnp.mean(x * y, 3), jnp.mean(y * y, 3)
    total = xx + yy
    xx, yy = xx + _FLAT * total, yy + _FLAT * total
    first = jnp.sqrt(xx)
    return jnp.sqrt(total), (first, xy / first, jnp.sqrt(jnp.maximum(yy - xy * xy / xx, _FLAT * total)))


def _directions(root: tuple[Array, ...], number: int, shift: float) -> Array:
    """Unit vectors (C, P, S, M, 2, N) that are even for an ellipse of that covariance, counter-clockwise."""
    angle = 2 * np.pi * (np.arange(number) + shift) / number
    u, v = (jnp.asarray(turn(angle), root[0].dtype)[:, None] for turn in (np.cos, np.sin))
    first, mixed, second = (each[:, :, :, None] for each in root)
    direction = jnp.stack([second * u - mixed * v, first * v], 4)
    return direction * jax.lax.rsqrt(jnp.sum(direction**2, 4, keepdims=True))


def _farthest(nodes: Array, directions: Array) -> Array:
    """The nodes (C, P, S, M, 2, N) of (C, P, S, V, 2, N) that lie farthest in directions (C, P, S, M, 2, N)."""
    still, way = jax.lax.stop_gradient((nodes[:, :, :, None], directions[:, :, :, :, None]))
    best = jnp.argmax(still[..., 0, :] * way[..., 0, :] + still[..., 1, :] * way[..., 1, :], 4)
    return jnp.take_along_axis(nodes, best[:, :, :, :, None], 3)
