"""The image side of the cost: points on occluding contours of superquadrics, edges along their normals, and what parts hide.

Along a ring of one latitude the surface faces the eye on one side and turns away on the other; between two nodes where that
changes lies the contour, at the longitude at which the cosine with the way to the eye, taken as linear, is 0. The point is that
of the surface at this longitude, so that it moves smoothly with the pose. A ring that is seen as a whole, or not at all, has no
such points: their share falls smoothly from 1 to 0 as the ring turns so.

From each point of a contour a line goes out to both sides. Along it every maximum of the edge map above a threshold is a
possible assignment; of these the strongest few are kept, each with its offset along the normal, found to a fraction of a pixel
by a parabola, and its strength.

A part is replaced by the ellipsoid of its half-axes. In a frame in which that is the unit ball, the ray from the eye to a point
is still a straight line. The part hides the point if the line comes nearer to the ball's centre than 1 before it ends. With the
smallest such distance d of part q,

    hidden = 1 - prod over the parts q but the point's own of (1 - sigmoid((1 - d_q) min(a, b, c) / softness)).

A point inside of another part is hidden too, as joints want it. Tapers, bends and exponents are left out.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.motion.geometry.cameras import Cameras, project_components
from poseppl.motion.likelihoods.distance_maps import at_points
from poseppl_models.sminchisescu_triggs.superquadrics import Nodes, Superquadrics, local_nodes, nodes_at, place_in


class ContourNodes(NamedTuple):
    """Points of occluding contours in one camera.

    Attributes:
        points: In the world (P, K, 3, N), mm; K is twice the number of rings.
        image: In the image (P, K, 2, N).
        normals: Unit normals of the contour in the image, outwards (P, K, 2, N).
        share: 1 where there is such a point, 0 where there is none (P, K, N).
    """

    points: Array
    image: Array
    normals: Array
    share: Array


def contour_nodes(
    camera: Cameras,
    flesh: Superquadrics,
    axes: Array,
    centres: Array,
    latitudes: Array,
    longitudes: Array,
    *,
    lean: float = 0.15,
) -> ContourNodes:
    """Points of the contours of all parts in one camera.

    Args:
        camera: One camera, leaves (..., N or 1) without an axis of cameras.
        flesh: P parts, leaves (P, ..., N or 1).
        axes: Columns x, y and z of the parts in the world (P, 3, 3, N).
        centres: Centres of the parts in the world (P, 3, N), mm.
        latitudes: Latitudes of the rings.
        longitudes: Longitudes of the nodes between which a contour is sought, all around.
        lean: Cosine between surface and view up to which a ring has to lean both ways to count as crossed.
    """
    facing = nodes_facing(camera, place_in(axes, centres, local_nodes(flesh, latitudes, longitudes)))  # (P, R, W, N)
    after, gap = jnp.roll(facing, -1, 2), longitudes[1] - longitudes[0]
    places = []
    for sign in (1.0, -1.0):
        on = (sign * facing < 0) & (sign * after >= 0)
        first = on & (jnp.cumsum(on, 2) == 1)
        share = jnp.where(first, facing, 0.0) / jnp.where(first, facing - after, 1.0)
        start = jnp.sum(jnp.where(first, longitudes[:, None], 0.0), 2)
        places.append(start + gap * jnp.sum(share, 2))
    omega = jnp.stack(places, 2)  # (P, R, 2, N)
    nodes = place_in(axes, centres, nodes_at(flesh, latitudes[None, :, None, None], omega))
    points, normals = (leaf.reshape(leaf.shape[0], -1, *leaf.shape[3:]) for leaf in nodes)
    both = jnp.minimum(jnp.max(facing, 2), -jnp.min(facing, 2))[:, :, None]
    share = _smooth_step(jnp.broadcast_to(both, omega.shape) / lean)
    image, moved = jax.jvp(lambda place: project_point(camera, place), (points,), (normals,))
    moved = moved * jax.lax.rsqrt(jnp.sum(moved**2, 2, keepdims=True) + 1e-12)
    return ContourNodes(points, image, moved, share.reshape(share.shape[0], -1, share.shape[-1]))


def nodes_facing(camera: Cameras, nodes: Nodes) -> Array:
    """Cosine (P, R, W, N) between nodes' normals and the way to the eye of one camera; a node is seen where it is positive."""
    towards = camera.centre - nodes.points
    return jnp.sum(towards * nodes.normals, 3) * jax.lax.rsqrt(jnp.sum(towards**2, 3))


def project_point(camera: Cameras, points: Array) -> Array:
    """Image points (..., 2, N) of points (..., 3, N) in one camera, leaves (..., N or 1)."""
    return jnp.stack(project_components(camera, *(points[..., i, :] for i in range(3))), -2)


def _smooth_step(x: Array) -> Array:
    """0 up to 0, 1 from 1 on, with a continuous slope."""
    x = jnp.clip(x, 0.0, 1.0)
    return x * x * (3 - 2 * x)


_NONE = -1.0


class Assignments(NamedTuple):
    """Edges along normals: ``offset`` (..., E, N) px outwards, and ``strength`` (..., E, N), 0 where there is none."""

    offset: Array
    strength: Array


def edges_along_normals(
    edges: Array,
    scale: Array,
    image: Array,
    normals: Array,
    *,
    window: int,
    number: int,
    threshold: float,
    step: Array | float = 1.0,
) -> Assignments:
    """Search for edges.

    Args:
        edges: Map of one camera (H, W, 1), at least 0.
        scale: Pixels of the map to one of the image (1,).
        image: Points (..., 2, N), px.
        normals: Unit normals (..., 2, N).
        window: How far to both sides it is searched, steps.
        number: E.
        threshold: Strength that an edge has to have.
        step: From one place where it is looked to the next, px.
    """
    steps = (
        step * jnp.asarray(np.arange(-window - 1, window + 2), image.dtype)[:, None]
    )  # one more to both sides to find maxima
    along = image[..., None, :, :] + steps[:, None] * normals[..., None, :, :]
    value = at_points(edges[None], scale[None], along[..., 0, :][None], along[..., 1, :][None])[0]  # (..., K + 2, N)
    before, here, after = value[..., :-2, :], value[..., 1:-1, :], value[..., 2:, :]
    peak = (here > before) & (here >= after) & (here > threshold)
    bend = before - 2 * here + after
    fine = jnp.where(bend < 0, 0.5 * (before - after) / jnp.where(bend < 0, bend, -1.0), 0.0)
    place = steps[1:-1] + step * jnp.clip(fine, -0.5, 0.5)
    left = jnp.where(peak, here, _NONE)
    offsets, strengths = [], []
    for _ in range(number):
        best = jnp.max(left, -2, keepdims=True)
        chosen = (left == best) & peak
        chosen = chosen & (jnp.cumsum(chosen, -2) == 1)
        offsets.append(jnp.sum(jnp.where(chosen, place, 0.0), -2))
        strengths.append(jnp.maximum(best[..., 0, :], 0.0))
        left = jnp.where(chosen, _NONE, left)
    return Assignments(jnp.stack(offsets, -2), jnp.stack(strengths, -2))


def hidden(flesh: Superquadrics, axes: Array, centres: Array, eye: Array, points: Array, softness: float) -> Array:
    """How much points of the parts are hidden by the others (P, K, N), from 0 to 1.

    Args:
        flesh: P parts, leaves (P, ..., N or 1).
        axes: Columns x, y and z of the parts in the world (P, 3, 3, N).
        centres: Centres of the parts in the world (P, 3, N), mm.
        eye: Position of the camera (3, N or 1), mm.
        points: Points of each part in the world (P, K, 3, N), mm.
        softness: How far inside of the silhouette of a part it takes to be hidden, mm.
    """
    scaled = axes / flesh.half_axes[:, None]  # columns as long as one over the half-axis
    start = _turned(scaled, eye - centres)[:, None, None]  # (Q, 1, 1, 3, N)
    end = _turned(scaled[:, None, None], points - centres[:, None, None])  # (Q, P, K, 3, N)
    way = end - start
    share = jnp.clip(-jnp.sum(start * way, 3) / jnp.sum(way * way, 3), 0.0, 1.0)
    nearest = start + share[:, :, :, None] * way
    distance = jnp.sqrt(jnp.sum(nearest * nearest, 3) + 1e-9)
    thin = jnp.min(flesh.half_axes, 1)[:, None, None]
    shown = jax.nn.log_sigmoid((distance - 1) * thin / softness)
    others = 1 - jnp.eye(centres.shape[0], dtype=points.dtype)[:, :, None, None]
    return -jnp.expm1(jnp.sum(others * shown, 0))


def _turned(axes: Array, vectors: Array) -> Array:
    """Components along the columns of axes (..., 3, 3, N) of vectors (..., 3, N)."""
    return jnp.stack([jnp.sum(axes[..., :, i, :] * vectors, -2) for i in range(3)], -2)
