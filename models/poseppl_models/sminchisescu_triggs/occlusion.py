"""Which points of a body its own parts hide from the eye, smoothly, batch last.

A part is replaced by the ellipsoid of its half-axes. In a frame in which that is the unit ball, the ray from the eye to a point
is still a straight line. The part hides the point if the line comes nearer to the ball's centre than 1 before it ends. With the
smallest such distance d of part q,

    hidden = 1 - prod over the parts q but the point's own of (1 - sigmoid((1 - d_q) min(a, b, c) / softness)).

A point inside of another part is hidden too, as joints want it. Tapers, bends and exponents are left out.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import Array

from poseppl_models.sminchisescu_triggs.superquadrics import Superquadrics


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
