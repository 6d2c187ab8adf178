"""How much of given image points a body covers: its silhouette, hard and smooth.

The image of an elliptical truncated cone is bounded by the images of its two rings, ellipses to first order in the ring's size
over its distance, and by the two straight edges between them: it is the union of two ellipses and of the quadrilateral between
these edges (:mod:`poseppl.geometry.outlines`). Each of the three has a signed distance d in pixels, negative inside; that of a
part is the least of them, and a point is covered by the body if d < 0 for some part. The smooth coverage is

    c = 1 - prod over parts (1 - sigmoid(-d / softness)),

which tends to the hard one as the softness goes to zero, and never has a zero gradient. Distances are exact beside the straight
edges, and to first order at the ellipses. Points behind other parts count as covered alike: silhouettes know no depth.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from poseppl.geometry.cameras import Cameras, project_components
from poseppl.geometry.flesh import Flesh, PartFrames
from poseppl.geometry.outlines import outline_corners

_TINY = 1e-12
_THICKNESS = 0.5
"""Half-width (px) below which a ring seen from its side is not taken to be thinner."""


class Shapes(NamedTuple):
    """What the parts look like in the images, batch last.

    Attributes:
        normals: Outward unit normals of the quadrilaterals' sides (C, P, 4, 2, N).
        offsets: Their distances from the origin (C, P, 4, N): a point u is inside where normal . u < offset for all four.
        centres: Of the rings' ellipses (C, P, 2, 2, N), px.
        inverses: Entries xx, xy, yy of their inverse squared half-axes (C, P, 2, 3, N).
    """

    normals: jax.Array
    offsets: jax.Array
    centres: jax.Array
    inverses: jax.Array


def project_parts(cameras: Cameras, flesh: Flesh, parts: PartFrames) -> Shapes:
    """Images of all parts in all cameras, batch last, as :func:`poseppl.geometry.outlines.outline_corners` takes them."""
    corners = outline_corners(cameras, flesh, parts)
    sides = jnp.roll(corners, -1, 2) - corners
    # twice the area, positive where the corners go round counter-clockwise: it tells outwards from inwards
    diagonals = corners[:, :, 2:] - corners[:, :, :2]
    area = diagonals[:, :, 0, 0] * diagonals[:, :, 1, 1] - diagonals[:, :, 0, 1] * diagonals[:, :, 1, 0]
    sign = jnp.where(area >= 0, 1.0, -1.0)[:, :, None]
    length = jnp.sqrt(sides[:, :, :, 0] ** 2 + sides[:, :, :, 1] ** 2 + _TINY)
    normals = jnp.stack([sides[:, :, :, 1] * sign / length, -sides[:, :, :, 0] * sign / length], 3)
    offsets = jnp.sum(normals * corners, 3)
    centres, inverses = _ellipses(cameras, flesh, parts)
    return Shapes(normals, offsets, centres, inverses)


def part_distances(shapes: Shapes, points: jax.Array) -> jax.Array:
    """Signed distances (C, P, K, N) in px of image points (C, K, 2, N or 1) from every part, negative inside."""
    x, y = points[:, None, :, 0], points[:, None, :, 1]
    sides = [
        shapes.normals[:, :, None, i, 0] * x + shapes.normals[:, :, None, i, 1] * y - shapes.offsets[:, :, None, i]
        for i in range(4)
    ]
    quadrilateral = jnp.maximum(jnp.maximum(sides[0], sides[1]), jnp.maximum(sides[2], sides[3]))
    return jnp.minimum(quadrilateral, jnp.minimum(_from_ellipse(shapes, 0, x, y), _from_ellipse(shapes, 1, x, y)))


def soft_coverage(distances: jax.Array, softness: jax.Array) -> jax.Array:
    """log(1 - c) of points (C, K, N): the log-probability that no part covers them.

    Args:
        distances: Signed distances (C, P, K, N), px.
        softness: Shape (C, N or 1), px.
    """
    return -jnp.sum(jax.nn.softplus(-distances / softness[:, None, None]), 1)


def hard_coverage(distances: jax.Array) -> jax.Array:
    """Whether some part covers points (C, K, N)."""
    return jnp.any(distances < 0, 1)


def _ellipses(cameras: Cameras, flesh: Flesh, parts: PartFrames) -> tuple[jax.Array, jax.Array]:
    """Centres and inverse squared half-axes of the rings' images."""
    rings = jnp.stack([parts.base, parts.tip], 1)  # (P, 2, 3, N)
    half = flesh.radii[:, :, None] * flesh.scales[:, None]  # (P, 2 rings, 2 axes, 1)
    arms = [parts.axes[:, None, :, axis] * half[:, :, axis, None] for axis in range(2)]  # (P, 2, 3, N) each
    spread: Cameras = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -2)[..., None, None, :], cameras)

    def image(x: jax.Array, y: jax.Array, z: jax.Array) -> tuple[jax.Array, jax.Array]:
        return project_components(spread, x, y, z)

    count = cameras.centre.shape[0]
    place = tuple(jnp.broadcast_to(rings[None, :, :, i], (count, *rings.shape[:2], rings.shape[-1])) for i in range(3))
    centre = image(*place)
    moved = []
    for arm in arms:
        tangent = tuple(jnp.broadcast_to(arm[None, :, :, i], place[0].shape) for i in range(3))
        moved.append(jax.jvp(image, place, tangent)[1])
    (ax, ay), (bx, by) = moved
    xx, xy, yy = ax * ax + bx * bx + _THICKNESS**2, ax * ay + bx * by, ay * ay + by * by + _THICKNESS**2
    determinant = xx * yy - xy * xy
    return jnp.stack(centre, 3), jnp.stack([yy / determinant, -xy / determinant, xx / determinant], 3)


def _from_ellipse(shapes: Shapes, ring: int, x: jax.Array, y: jax.Array) -> jax.Array:
    """Signed distance to first order: (q - 1) / |grad q|, with q the distance in units of the ellipse."""
    dx, dy = x - shapes.centres[:, :, ring, 0, None], y - shapes.centres[:, :, ring, 1, None]
    xx, xy, yy = (shapes.inverses[:, :, ring, i, None] for i in range(3))
    gx, gy = xx * dx + xy * dy, xy * dx + yy * dy
    q = jnp.sqrt(dx * gx + dy * gy + _TINY)
    return (q - 1) * q * jax.lax.rsqrt(gx * gx + gy * gy + _TINY)
