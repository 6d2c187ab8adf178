"""Distances from the occluding edges of a body's parts to the nearest edges in images, batch last.

The side of a part seen against another colour is an edge in the image: along the silhouette and also, unlike in the
silhouette, where an arm passes before the trunk. Points on both straight sides of each part are looked up in a map of distances
to the image's edges. Distances are cut off at some pixels, which is also the value of a side that is hidden or without
contrast.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
from jax import Array

from poseppl.motion.geometry.cameras import Cameras
from poseppl.motion.geometry.flesh import Flesh, PartFrames
from poseppl.motion.geometry.outlines import limb_corners
from poseppl.motion.likelihoods.distance_maps import at_points

FRACTIONS = (0.2, 0.5, 0.8)
"""Fractions of each side at which the distance to the next edge is looked up."""
SAMPLES = 2 * len(FRACTIONS)


def edge_distances(
    cameras: Cameras,
    flesh: Flesh,
    parts: PartFrames,
    edges: Array,
    scale: Array,
    fractions: Sequence[float] | Array = FRACTIONS,
) -> Array:
    """Distances (C, P, 2 * fractions, N), px: first those of one side, then those of the other.

    Args:
        cameras: C cameras, leaves (C, ..., N or 1).
        flesh: Sizes of P parts.
        parts: Their positions and axes, leaves (P, ..., N).
        edges: Distances to the nearest edge (C, H, W, 1), px of the image.
        scale: Pixels of the maps to one of the image (C, 1).
        fractions: Fractions of the sides, from base to tip.
    """
    corners = limb_corners(cameras, flesh, parts)  # (C, P, 4, 2, N): base, tip, tip, base
    share = jnp.asarray(fractions)[:, None, None]
    sides = [
        corners[:, :, None, base] + share * (corners[:, :, tip] - corners[:, :, base])[:, :, None]
        for base, tip in ((0, 1), (3, 2))
    ]
    points = jnp.concatenate(sides, 2)
    return at_points(edges, scale, points[:, :, :, 0], points[:, :, :, 1])
