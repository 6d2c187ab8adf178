"""Points where the rings of superquadrics cross their occluding contours, two a ring, batch last.

Along a ring of one latitude the surface faces the eye on one side and turns away on the other; between two nodes where that
changes lies the contour, at the longitude at which the cosine with the way to the eye, taken as linear, is 0. The point is that
of the surface at this longitude, so that it moves smoothly with the pose. A ring that is seen as a whole, or not at all, has no
such points: their share falls smoothly from 1 to 0 as the ring turns so.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.motion.geometry.cameras import Cameras, project_components
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
