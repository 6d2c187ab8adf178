"""Maps that a likelihood looks up: distance to an edge, signed distance to the silhouette, and integral images.

Distances are in px between centres of pixels, exact Euclidean ones (Felzenszwalb and Huttenlocher 2012), and truncated: a far
pixel says no more than that it is far, which bounds what clutter can cost.

>>> mask = np.zeros((5, 9), np.uint8)
>>> mask[1:4, 2:7] = 1
>>> silhouette_distance(mask, truncation=2.0)[2].tolist()
[1.5, 0.5, -0.5, -1.5, -1.5, -1.5, -0.5, 0.5, 1.5]
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from poseppl.motion.io.opencv import opencv
from poseppl.motion.vision.bounding_box import window
from poseppl.motion.vision.edges import Map
from poseppl.motion.vision.masks import Mask


def edge_distance(edges: Mask, truncation: float) -> Map:
    """Measure the distance to the nearest edge.

    Args:
        edges: (H, W) uint8, 1 at an edge.
        truncation: The largest distance that is told apart, px.

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
        truncation: The largest distance that is told apart, px.

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


def integral_image(plane: NDArray[np.generic]) -> NDArray[np.float64]:
    """Sum an image from its upper left corner (Viola and Jones 2001, equation 1).

    Args:
        plane: (H, W) of any type of numbers that OpenCV adds: uint8, float32, float64.

    Returns:
        (H + 1, W + 1): at (y, x) the sum over the rows above y and the columns left of x, in units of the image.
    """
    cv2 = opencv()
    sums: NDArray[np.float64] = cv2.integral(plane, sdepth=cv2.CV_64F)
    return sums


def box_sum(
    sums: NDArray[np.float64],
    left: NDArray[np.int64] | int,
    top: NDArray[np.int64] | int,
    right: NDArray[np.int64] | int,
    bottom: NDArray[np.int64] | int,
) -> NDArray[np.float64]:
    """Sum an image over boxes; a part of a box outside the image adds nothing.

    Args:
        sums: (H + 1, W + 1) integral image.
        left: The first column, of any shape (...).
        top: The first row.
        right: The column after the last.
        bottom: The row after the last.

    Returns:
        (...) sums.
    """
    height, width = sums.shape[0] - 1, sums.shape[1] - 1
    x0, x1 = (np.clip(np.asarray(value), 0, width) for value in (left, right))
    y0, y1 = (np.clip(np.asarray(value), 0, height) for value in (top, bottom))
    total: NDArray[np.float64] = np.asarray(sums[y1, x1] - sums[y0, x1] - sums[y1, x0] + sums[y0, x0])
    return total


def _distance_to(mask: Mask) -> Map:
    cv2 = opencv()
    if not mask.any():
        return np.full(mask.shape, np.inf, np.float32)
    # The last digit depends on where the memory lies. Squares are whole numbers, and numpy rounds their roots correctly.
    rough = cv2.distanceTransform(1 - mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    distance: Map = np.sqrt(np.rint(rough * rough))
    return distance
