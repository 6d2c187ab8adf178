"""Maps that a likelihood looks up: distance to an edge and signed distance to the silhouette.

Distances are in px between centres of pixels, exact Euclidean ones (Felzenszwalb and Huttenlocher 2012), and truncated: a far
pixel says no more than that it is far, which bounds what clutter can cost.

>>> mask = np.zeros((5, 9), np.uint8)
>>> mask[1:4, 2:7] = 1
>>> silhouette_distance(mask, truncation=2.0)[2].tolist()
[1.5, 0.5, -0.5, -1.5, -1.5, -1.5, -0.5, 0.5, 1.5]
"""

from __future__ import annotations

import numpy as np

from poseppl.motion.io.opencv import opencv
from poseppl.motion.vision.bounding_box import window
from poseppl.motion.vision.edges import Map
from poseppl.motion.vision.masks import Mask


def edge_distance(edges: Mask, truncation: float) -> Map:
    """Measure the distance to the nearest edge.

    Args:
        edges: (H, W) uint8, 1 at an edge.
        truncation: Distances are cut off at so many px.

    Returns:
        (H, W) px: 0 on an edge, at most ``truncation``; that everywhere where there is no edge.
    """
    limit = np.float32(truncation)
    distance = np.full(edges.shape, limit, np.float32)
    part = window(edges, truncation)
    if part is not None:
        distance[part] = np.minimum(_distance_to(edges[part]), limit)
    return distance


def silhouette_distance(foreground: Mask, truncation: float) -> Map:
    """Measure the signed distance to the outline of the silhouette, which runs between pixels.

    Args:
        foreground: (H, W) uint8, 1 inside.
        truncation: Distances are cut off at so many px.

    Returns:
        (H, W) px in [-truncation, truncation]: negative inside, -0.5 and 0.5 at the two sides of the outline. All
        ``truncation`` where nothing is inside, and -``truncation`` where everything is.
    """
    limit = np.float32(truncation)
    distance = np.full(foreground.shape, limit, np.float32)
    part = window(foreground, truncation + 1.0)
    if part is not None:
        inside = (foreground != 0).astype(np.uint8)
        distance[part] = np.minimum(_distance_to(inside[part]) - np.float32(0.5), limit)
        near = window(foreground, 1.0) or part
        inward = np.float32(0.5) - _distance_to(1 - inside[near])
        np.copyto(distance[near], np.maximum(inward, -limit), where=inside[near] != 0)
    return distance


def _distance_to(mask: Mask) -> Map:
    cv2 = opencv()
    if not mask.any():
        return np.full(mask.shape, np.inf, np.float32)
    # The last digit depends on where the memory lies. Squares are whole numbers, and numpy rounds their roots correctly.
    rough = cv2.distanceTransform(1 - mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    distance: Map = np.sqrt(np.rint(rough * rough))
    return distance
