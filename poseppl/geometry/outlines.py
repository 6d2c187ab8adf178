"""Outlines of cones in images: the quadrilateral between the two occluding edges of each part, in each camera.

Seen from an eye, a long truncated cone is bounded by two straight edges. They leave its rings near the points where the
direction u across the axis is at right angles to the view: with r from the eye to the middle of the axis, in the part's
coordinates divided by the factors of its radii,

    u = (-r_y, r_x) / |(r_x, r_y)|,    corners: base -+ radius_base u,  tip -+ radius_tip u,

exact for a cylinder far away. The corners go round: base, tip, tip, base. Everything is batch last.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp

from poseppl.geometry.cameras import Cameras, project_components
from poseppl.geometry.flesh import Flesh, PartFrames

_TINY = 1e-12


def outline_corners(cameras: Cameras, flesh: Flesh, parts: PartFrames) -> jax.Array:
    """Corners of every part's outline in every camera.

    Args:
        cameras: C cameras, leaves (C, ..., N or 1).
        flesh: Sizes of the parts, leaves (P, ..., N or 1).
        parts: Where they are, leaves (P, ..., N).

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
    first, last = u * flesh.radii[:, 0][:, None], u * flesh.radii[:, 1][:, None]
    corners = jnp.stack([parts.base - first, parts.tip - last, parts.tip + last, parts.base + first], 2)
    spread: Cameras = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -2)[..., None, None, :], cameras)
    return jnp.stack(project_components(spread, corners[:, :, :, 0], corners[:, :, :, 1], corners[:, :, :, 2]), 3)
