"""Edges inside the foreground, and maps that a likelihood looks up: distances to an edge and to the silhouette.

Darby et al. (2008, section 6.1) find edges with a gradient mask, threshold them, smooth them with a Gaussian and rescale the
result to [0, 1], a measure of proximity to an edge; Peursum et al. (2008, section 5) threshold a Sobel mask and use the
foreground as a mask on the edges. ``benchmark_edge_map`` is the edge map of the PARSEC benchmark bodytrack.

Distances are in px between centres of pixels, exact Euclidean ones (Felzenszwalb and Huttenlocher 2012), and truncated: a far
pixel says no more than that it is far, which bounds what clutter can cost.

>>> mask = np.zeros((5, 9), np.uint8)
>>> mask[1:4, 2:7] = 1
>>> silhouette_distance(mask, truncation=2.0)[2].tolist()
[1.5, 0.5, -0.5, -1.5, -1.5, -1.5, -0.5, 0.5, 1.5]
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseppl.checks import check_at_least
from poseppl.motion.io.opencv import Image, check_image, opencv
from poseppl.motion.vision.masks import Mask, window

Map = NDArray[np.float32]
BENCHMARK_SQUARED_THRESHOLD = 16.0
BENCHMARK_TAPS = 7
BENCHMARK_SIGMA = 4.0


class EdgeSettings(NamedTuple):
    """How edges are found.

    Attributes:
        threshold: Least gradient of an edge, gray levels a px.
        dilation: By how many px the foreground is widened before it masks the edges: its own outline must stay in.
        sigma: Standard deviation of the smoothing, px.
    """

    threshold: float = 8.0
    dilation: int = 4
    sigma: float = 3.0

    def check(self) -> EdgeSettings:
        """Refuse settings that cannot be used.

        Returns:
            The settings.

        Raises:
            ValueError: A number is negative, or ``sigma`` is under 0.3 px.
        """
        check_at_least(0, threshold=self.threshold, dilation=self.dilation)
        check_at_least(0.3, sigma=self.sigma)
        return self


def gray(image: Image) -> Image:
    """Turn an image gray.

    Args:
        image: (H, W, 3) RGB or (H, W) gray.

    Returns:
        (H, W), 0.299 R + 0.587 G + 0.114 B.
    """
    cv2, checked = opencv(), check_image(image)
    converted: Image = checked if checked.ndim == 2 else cv2.cvtColor(checked, cv2.COLOR_RGB2GRAY)
    return converted


def gradient(image: Image) -> tuple[Map, Map]:
    """Differentiate an image with 3 x 3 Sobel masks.

    Args:
        image: (H, W, 3) RGB or (H, W) gray.

    Returns:
        (H, W) derivatives to the right and downwards, gray levels a px.
    """
    cv2, plane = opencv(), gray(image)
    right: Map = cv2.Sobel(plane, cv2.CV_32F, 1, 0, ksize=3, scale=0.125)
    down: Map = cv2.Sobel(plane, cv2.CV_32F, 0, 1, ksize=3, scale=0.125)
    return right, down


def find_edges(image: Image, settings: EdgeSettings, foreground: Mask | None = None) -> Mask:
    """Find the edges of a frame.

    Args:
        image: (H, W, 3) RGB or (H, W) gray.
        settings: Threshold and dilation.
        foreground: (H, W) uint8, 1 at the foreground; edges farther than ``dilation`` px from it are left out. None keeps all.

    Returns:
        (H, W) uint8, 1 at an edge.
    """
    cv2, plane = opencv(), gray(image)
    edges = np.zeros(plane.shape, np.uint8)
    if foreground is None:
        part, wide = (slice(None), slice(None)), None
    else:
        # A margin of 2 px more: the gradient at the window's rim is that of the whole image.
        found = window(foreground, settings.dilation + 2)
        if found is None:
            return edges
        part, diameter = found, 2 * settings.dilation + 1
        wide = cv2.dilate(foreground[part], cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (diameter, diameter)))
    right, down = gradient(plane[part])
    strong = (cv2.magnitude(right, down) >= np.float32(max(settings.threshold, 1e-6))).astype(np.uint8)
    edges[part] = strong if wide is None else strong & wide
    return edges


def edge_proximity(edges: Mask, sigma: float) -> Map:
    """Smooth edges into a measure of proximity.

    A long straight edge, which Sobel masks mark 2 px wide, has proximity 1 on it and exp(-d^2 / 2 sigma^2) at a distance of
    d px. The smoothed sum is larger where edges crowd, and is cut off at 1; rescaled by its maximum, as the paper may mean,
    a single edge would count for little in every frame that has texture.

    Args:
        edges: (H, W) uint8, 1 at an edge.
        sigma: Standard deviation of the Gaussian, px.

    Returns:
        (H, W) in [0, 1].
    """
    cv2 = opencv()
    line = np.zeros((1, 2 * int(np.ceil(4 * sigma)) + 2), np.float32)
    line[0, line.shape[1] // 2 - 1 : line.shape[1] // 2 + 1] = 1.0
    peak = float(cv2.GaussianBlur(line, (0, 0), sigma).max())
    proximity = np.zeros(edges.shape, np.float32)
    part = window(edges, 5 * sigma)
    if part is not None:
        smooth = cv2.GaussianBlur(edges[part].astype(np.float32), (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)
        proximity[part] = np.minimum(smooth / np.float32(peak), np.float32(1.0))
    return proximity


def benchmark_edge_map(image: Image) -> Image:
    """Compute the edge map of the PARSEC benchmark bodytrack.

    A 3 x 3 Sobel mask divided by 8; 0 where the squared magnitude is under 16, 255 elsewhere; a Gaussian of 7 taps and a sigma
    of 4 px along rows, cut to whole numbers, then along columns, cut again. The benchmark
    computes nothing where a mask would reach beyond the image; here the 3 outermost rows and columns are 0.

    Args:
        image: (H, W, 3) RGB or (H, W) gray.

    Returns:
        (H, W) in 0, 1, ..., 255.
    """
    cv2 = opencv()
    right, down = gradient(image)
    binary = np.where(right * right + down * down < BENCHMARK_SQUARED_THRESHOLD, 0.0, 255.0).astype(np.float32)
    binary[[0, -1], :] = 0.0
    binary[:, [0, -1]] = 0.0
    kernel = cv2.getGaussianKernel(BENCHMARK_TAPS, BENCHMARK_SIGMA, cv2.CV_32F)
    rows = np.floor(cv2.filter2D(binary, cv2.CV_32F, kernel.T))
    columns = np.floor(cv2.filter2D(rows, cv2.CV_32F, kernel))
    edge_map, reach = np.zeros(binary.shape, np.uint8), BENCHMARK_TAPS // 2
    edge_map[reach:-reach, reach:-reach] = columns[reach:-reach, reach:-reach]
    return edge_map


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
