"""Outlines of cones in images: the quadrilateral between the two occluding edges of each part, in each camera.

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

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.motion.geometry.cameras import Cameras, beside_points, project_components
from poseppl.motion.geometry.flesh import Flesh, PartFrames

_TINY = 1e-12
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
