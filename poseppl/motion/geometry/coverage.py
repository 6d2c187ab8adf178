"""Images of a body of cones: the outline of each part, and how much of given image points it covers, hard and smooth.

The image of an elliptical truncated cone is the convex hull of the images of its two rings. This is the union of two ellipses
and of the quadrilateral between the two straight edges that touch both (:func:`limb_corners`).
The image of a ring with centre c and half-axes a and b, all in the camera's frame, has the dual conic (a ball has a third
half-axis)

    c c' - a a' - b b',

of which the ellipse's centre and half-axes are read off. Each of the three shapes has a signed distance d in pixels, negative
inside; that of a part is the least of them, and a point is covered by the body if d < 0 for some part. The smooth coverage is

    c = 1 - prod over parts (1 - sigmoid(-d / softness)),

which tends to the hard one as the softness goes to zero, and never has a zero gradient. Distances are exact beside the straight
edges, and to first order at the ellipses.

A pinhole camera outside the body has an exact silhouette, except that rings seen from their side are drawn half a pixel thick.
Lens distortion adds errors: it bends the edges and is taken to be linear over a ring. So does a ring so near that it reaches
the plane of the camera. A body whose balls differ in radius lacks a sliver beside the edges. Points behind
other parts count as covered alike: silhouettes know no depth.

Seen from an eye, a long truncated cone is bounded by two straight edges. They leave its rings near the points where the
direction u across the axis is at right angles to the view. With r from the eye to the middle of the axis, in the part's
coordinates divided by the factors of its radii,

    u = (-r_y, r_x) / |(r_x, r_y)|,    corners: base -+ radius_base u,  tip -+ radius_tip u,

exact for a cylinder far away (:func:`outline_corners`). An edge in the image of a pinhole is exactly that of a plane through
the eye that touches the cone. With o the eye and R(z) the radius at height z in the same coordinates, it touches along the
direction n with

    n . (o_x, o_y) = R(o_z),    corners: base + radius_base n,  tip + radius_tip n

(:func:`limb_corners`); without solution, from within the cone's extension, no edge is seen but that of an end. The corners go
round: base, tip, tip, base. Everything is batch last.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.motion.geometry.cameras import NEAREST, Cameras, beside_points, project_components
from poseppl.motion.geometry.flesh import Flesh, PartFrames

_TINY = 1e-12
_THICKNESS = 0.25
"""Half the thickness (px) of a ring that is seen from its side: with none, its distances would have no gradient."""
_MIN_DEPTH = 0.01
"""Least squared depth that a ring near the camera's plane is given, in units of its centre's; at 0 it is a parabola."""
_MIN_AREA = 1.0
"""Twice the area (px^2) below which a quadrilateral is left to the ellipses: its sides have no direction."""
_FAR = 1e6


class Shapes(NamedTuple):
    """Shapes of the parts in the images, batch last.

    Attributes:
        normals: Outward unit normals of the quadrilaterals' sides (C, P, 4, 2, N).
        offsets: Their distances from the origin (C, P, 4, N): a point u is inside where normal . u < offset for all four.
        centres: Centres of the rings' ellipses (C, P, 2, 2, N), px.
        inverses: Entries xx, xy, yy of their inverse squared half-axes (C, P, 2, 3, N).
    """

    normals: Array
    offsets: Array
    centres: Array
    inverses: Array


def project_parts(cameras: Cameras, flesh: Flesh, parts: PartFrames) -> Shapes:
    """Images of all parts in all cameras, batch last, as :func:`poseppl.motion.geometry.coverage.limb_corners` takes them."""
    corners = limb_corners(cameras, flesh, parts)
    sides = jnp.roll(corners, -1, 2) - corners
    # twice the area, positive where the corners go round counter-clockwise: it tells outwards from inwards
    diagonals = corners[:, :, 2:] - corners[:, :, :2]
    area = diagonals[:, :, 0, 0] * diagonals[:, :, 1, 1] - diagonals[:, :, 0, 1] * diagonals[:, :, 1, 0]
    sign = jnp.where(area >= 0, 1.0, -1.0)[:, :, None]
    length = jnp.sqrt(sides[:, :, :, 0] ** 2 + sides[:, :, :, 1] ** 2 + _TINY)
    normals = jnp.stack([sides[:, :, :, 1] * sign / length, -sides[:, :, :, 0] * sign / length], 3)
    offsets = jnp.where(jnp.abs(area)[:, :, None] < _MIN_AREA, -_FAR, jnp.sum(normals * corners, 3))
    centres, inverses = _ellipses(cameras, flesh, parts)
    return Shapes(normals, offsets, centres, inverses)


def part_distances(shapes: Shapes, points: Array) -> Array:
    """Signed distances (C, P, K, N) in px of image points (C, K, 2, N or 1) from every part, negative inside."""
    x, y = points[:, None, :, 0], points[:, None, :, 1]
    sides = [
        shapes.normals[:, :, None, i, 0] * x + shapes.normals[:, :, None, i, 1] * y - shapes.offsets[:, :, None, i]
        for i in range(4)
    ]
    quadrilateral = jnp.maximum(jnp.maximum(sides[0], sides[1]), jnp.maximum(sides[2], sides[3]))
    return jnp.minimum(quadrilateral, jnp.minimum(_from_ellipse(shapes, 0, x, y), _from_ellipse(shapes, 1, x, y)))


def soft_coverage(distances: Array, softness: Array) -> Array:
    """log(1 - c) of points (C, K, N): the log-probability that no part covers them.

    Args:
        distances: Signed distances (C, P, K, N), px.
        softness: Shape (C, N or 1), px.
    """
    return -jnp.sum(jax.nn.softplus(-distances / softness[:, None, None]), 1)


def hard_coverage(distances: Array) -> Array:
    """Whether some part covers points (C, K, N)."""
    return jnp.any(distances < 0, 1)


def _ellipses(cameras: Cameras, flesh: Flesh, parts: PartFrames) -> tuple[Array, Array]:
    """Centres and inverse squared half-axes of the images of the rings, or of the balls in their place."""
    spread = beside_points(cameras)
    u, v, uu, uv, vv = _rings(spread, flesh, parts)
    plane = spread._replace(rotation=jnp.eye(3), centre=jnp.zeros(3))
    one, none = jnp.ones_like(u), jnp.zeros_like(u)

    def image(u: Array, v: Array) -> tuple[Array, Array]:
        return project_components(plane, u, v, one)

    centre, (ax, ay) = jax.jvp(image, (u, v), (one, none))
    _, (bx, by) = jax.jvp(image, (u, v), (none, one))
    xx = ax * ax * uu + 2 * ax * bx * uv + bx * bx * vv + _THICKNESS**2
    xy = ax * ay * uu + (ax * by + bx * ay) * uv + bx * by * vv
    yy = ay * ay * uu + 2 * ay * by * uv + by * by * vv + _THICKNESS**2
    determinant = xx * yy - xy * xy
    return jnp.stack(centre, 3), jnp.stack([yy / determinant, -xy / determinant, xx / determinant], 3)


def _rings(spread: Cameras, flesh: Flesh, parts: PartFrames) -> tuple[Array, ...]:
    """In the plane at depth 1 of an undistorted camera: u and v of the centres, uu, uv and vv of the squared half-axes.

    Args:
        spread: Cameras whose matrix axes come first, (..., C, 1, 1, N).
        flesh: Sizes of the parts.
        parts: Their positions and axes.

    Returns:
        Five arrays (C, P, 2, N).
    """
    rings = jnp.stack([parts.base, parts.tip], 1)[None]  # (1, P, 2, 3, N)
    half = flesh.radii[:, :, None] * jnp.stack([flesh.scales[:, 0], flesh.scales[:, 1], flesh.balls], 1)[:, None]
    arms = [(parts.axes[:, None, :, axis] * half[:, :, axis, None])[None] for axis in range(3)]
    place = _turned(spread, [rings[:, :, :, j] - spread.centre[j] for j in range(3)])
    depth = jnp.maximum(place[2], NEAREST)
    u, v = place[0] / depth, place[1] / depth
    across, deep = [], []  # with the ring's centre as the plane's origin, where nothing large cancels
    for arm in arms:
        x, y, z = _turned(spread, [arm[:, :, :, j] for j in range(3)])
        across.append((x - u * z, y - v * z))
        deep.append(z)
    zz = jnp.maximum(depth**2 - sum(z * z for z in deep), _MIN_DEPTH * depth**2)
    du, dv = (-sum(pair[i] * z for pair, z in zip(across, deep, strict=True)) / zz for i in range(2))
    uu, uv, vv = (sum(pair[i] * pair[j] for pair in across) / zz for i, j in ((0, 0), (0, 1), (1, 1)))
    return u + du, v + dv, uu + du * du, uv + du * dv, vv + dv * dv


def _turned(spread: Cameras, vector: list[Array]) -> list[Array]:
    """Components of a vector of the world in the cameras' frames."""
    turn = spread.rotation
    return [turn[i, 0] * vector[0] + turn[i, 1] * vector[1] + turn[i, 2] * vector[2] for i in range(3)]


def _from_ellipse(shapes: Shapes, ring: int, x: Array, y: Array) -> Array:
    """Signed distance to first order: (q - 1) / |grad q|, with q the distance in units of the ellipse."""
    dx, dy = x - shapes.centres[:, :, ring, 0, None], y - shapes.centres[:, :, ring, 1, None]
    xx, xy, yy = (shapes.inverses[:, :, ring, i, None] for i in range(3))
    gx, gy = xx * dx + xy * dy, xy * dx + yy * dy
    q = jnp.sqrt(dx * gx + dy * gy + _TINY)
    return (q - 1) * q * jax.lax.rsqrt(gx * gx + gy * gy + _TINY)


_GRAZING = 0.9999
"""Cosine beyond which the eye counts as within the cone's extension."""


def outline_corners(cameras: Cameras, flesh: Flesh, parts: PartFrames) -> Array:
    """Corners of every part's outline in every camera.

    Args:
        cameras: C cameras, leaves (C, ..., N or 1).
        flesh: Sizes of the parts, leaves (P, ..., N or 1).
        parts: Their positions and axes, leaves (P, ..., N).

    Returns:
        Image points (C, P, 4, 2, N), in the cameras' image units.
    """
    eye = cameras.centre[:, None]  # (C, 1, 3, N)
    away = parts.base + parts.tip - 2 * eye  # (C, P, 3, N), twice the way from the eye to the middle
    x_axis, y_axis = parts.axes[:, :, 0], parts.axes[:, :, 1]
    across_x, across_y = flesh.scales[:, 0], flesh.scales[:, 1]
    along_x = jnp.sum(away * x_axis, 2) / across_x
    along_y = jnp.sum(away * y_axis, 2) / across_y
    norm = jax.lax.rsqrt(along_x**2 + along_y**2 + _TINY)
    # (C, P, 3, N): one radius across the part, in the world
    u = x_axis * (-along_y * norm * across_x)[:, :, None] + y_axis * (along_x * norm * across_y)[:, :, None]
    return _project(cameras, flesh, parts, -u, u)


def limb_corners(cameras: Cameras, flesh: Flesh, parts: PartFrames) -> Array:
    """Corners between the exact edges, for a camera without distortion; a sliver where the eye sees no edge.

    Arguments and result are those of :func:`outline_corners`.
    """
    offset = cameras.centre[:, None] - parts.base  # (C, P, 3, N)
    x_axis, y_axis = parts.axes[:, :, 0], parts.axes[:, :, 1]
    across_x, across_y = flesh.scales[:, 0], flesh.scales[:, 1]
    x, y = jnp.sum(offset * x_axis, 2) / across_x, jnp.sum(offset * y_axis, 2) / across_y
    slope = (flesh.radii[:, 1] - flesh.radii[:, 0]) / flesh.lengths
    level = flesh.radii[:, 0] + slope * jnp.sum(offset * parts.axes[:, :, 2], 2)
    norm = jax.lax.rsqrt(x * x + y * y + _TINY)
    cosine = jnp.clip(level * norm, -_GRAZING, _GRAZING)
    sine = jnp.sqrt(1 - cosine * cosine)
    towards = x_axis * (x * norm * across_x)[:, :, None] + y_axis * (y * norm * across_y)[:, :, None]
    aside = x_axis * (y * norm * across_x)[:, :, None] - y_axis * (x * norm * across_y)[:, :, None]
    near, far = towards * cosine[:, :, None], aside * sine[:, :, None]
    return _project(cameras, flesh, parts, near - far, near + far)


def _project(cameras: Cameras, flesh: Flesh, parts: PartFrames, first: Array, second: Array) -> Array:
    """Images of the ends of two edges, which run along directions (C, P, 3, N) across the axis, each of one radius."""
    base, tip = flesh.radii[:, 0][:, None], flesh.radii[:, 1][:, None]
    corners = jnp.stack(
        [parts.base + first * base, parts.tip + first * tip, parts.tip + second * tip, parts.base + second * base], 2
    )
    spread = beside_points(cameras)
    return jnp.stack(project_components(spread, corners[:, :, :, 0], corners[:, :, :, 1], corners[:, :, :, 2]), 3)
