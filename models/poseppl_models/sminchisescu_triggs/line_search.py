"""Edges along the normals of a contour: all maxima of an edge map within a window, batch last.

From each point of a contour a line goes out to both sides. Along it every maximum of the edge map above a threshold is a
possible assignment; of these the strongest few are kept, each with its offset along the normal, found to a fraction of a pixel
by a parabola, and its strength.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.motion.likelihoods.distance_maps import at_points

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
