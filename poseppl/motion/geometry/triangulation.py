"""Places in space from what several cameras see: rays, the distance between two of them, and the point nearest to many."""

from __future__ import annotations

import jax
import numpy as np

from poseppl.arrays import Floats
from poseppl.motion.geometry.cameras import Cameras, undistort


def viewing_rays(cameras: Cameras, camera: int, points: Floats) -> Floats:
    """Unit directions (..., 3) in the world of the rays of one camera's image points (..., 2).

    NaN where a point is, and where its lens puts nothing (:func:`~poseppl.motion.geometry.cameras.undistort`).
    """
    lens = jax.tree.map(lambda leaf: np.asarray(leaf, np.float64)[camera], cameras)
    plane = (points - lens.principal) / lens.focal
    if lens.distortion is not None:
        plane = undistort(lens.distortion, plane)
    ray = np.concatenate([plane, np.ones_like(plane[..., :1])], -1) @ lens.rotation
    return np.asarray(ray / np.linalg.norm(ray, axis=-1, keepdims=True))


def ray_distances(first: Floats, first_rays: Floats, second: Floats, second_rays: Floats) -> Floats:
    """Shortest distances (..., K), mm, between lines from two centres (..., 3) along unit directions (..., K, 3) each."""
    normal = np.cross(first_rays, second_rays)
    return np.asarray(
        np.abs((normal @ (second - first)[..., None])[..., 0]) / np.maximum(np.linalg.norm(normal, axis=-1), 1e-9)
    )


def nearest_points(centres: Floats, rays: Floats, weights: Floats) -> Floats:
    """The points with the least weighted sum of squared distances to rays.

    Args:
        centres: (C, 3) mm.
        rays: Unit directions (..., C, K, 3).
        weights: (..., C, K), 0 where a ray does not count.

    Returns:
        (..., K, 3) mm; NaN where fewer than two rays count.
    """
    counts = weights > 0
    rays = np.where(counts[..., None], rays, 0.0)
    across = weights[..., None, None] * (np.eye(3) - rays[..., :, None] * rays[..., None, :])
    matrix = across.sum(-4)
    right = np.einsum("...ckij,cj->...ki", across, centres)
    known = counts.sum(-2) >= 2
    matrix = np.where(known[..., None, None], matrix + 1e-12 * np.eye(3), np.eye(3))
    places = np.linalg.solve(matrix, right[..., None])[..., 0]
    return np.asarray(np.where(known[..., None], places, np.nan))


def triangulate(cameras: Cameras, points: Floats, confidence: Floats) -> Floats:
    """Places (T, K, 3), mm, of points (T, C, K, 2) that two cameras see, weighted by confidence; NaN elsewhere."""
    rays = np.stack([viewing_rays(cameras, c, points[:, c]) for c in range(points.shape[1])], 1)
    weights = np.where(np.isfinite(points).all(-1), confidence, 0.0)
    return nearest_points(np.asarray(cameras.centre, np.float64), rays, weights)
