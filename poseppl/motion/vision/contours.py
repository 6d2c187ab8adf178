"""The outer contour of a silhouette and its Fourier descriptors, which Du and Guan (2006, section 3) compare.

The contour is taken as a periodic function z(s) = x + i y of its length and expanded in Z_k exp(2 pi i k s). Descriptors are
the magnitudes |Z_k| / |Z_1| for k = -1, 2, -2, 3, -3, ...: leaving out Z_0 makes them invariant to translation, the division to
scale, the magnitudes to rotation and to the point that the contour starts from (Granlund 1972,
doi:10.1109/TC.1972.5008926). A mirrored silhouette has the same ones: they do not tell left from right.

>>> mask = np.zeros((40, 40), np.uint8)
>>> mask[10:30, 10:30] = 1
>>> fourier_descriptors(outer_contour(mask), 6).round(2).tolist()  # a square: turned by 90 degrees it is itself, k = 1, -3, 5
[0.0, 0.0, 0.0, 0.0, 0.11, 0.0]
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseppl.arrays import Floats
from poseppl.errors import InputError
from poseppl.motion.io.opencv import opencv
from poseppl.motion.vision.masks import Mask

Contour = NDArray[np.float64]
SAMPLES = 512
_MIN_AREA = 30
"""Regions and holes of fewer pixels are left out."""


def outer_contour(mask: Mask) -> Contour:
    """Trace the outline of the largest region, holes aside.

    Args:
        mask: (H, W), not 0 inside.

    Returns:
        (P, 2) centres of the region's outermost pixels, x and y in px, in order; (0, 2) for an empty mask.
    """
    cv2 = opencv()
    found, _ = cv2.findContours((np.asarray(mask) != 0).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not found:
        return np.zeros((0, 2))
    largest = max(found, key=lambda contour: (cv2.contourArea(contour), len(contour)))
    return np.asarray(largest, np.float64).reshape(-1, 2)


def fourier_descriptors(contour: Contour, count: int = 20) -> Floats:
    """Describe a contour.

    Args:
        contour: (P, 2) points of a closed contour, px.
        count: How many descriptors; 20 reach the frequencies 11 and -10, about a twentieth of a body's outline.

    Returns:
        (count,) without unit: |Z_k| / |Z_1|, k = -1, 2, -2, 3, ...; NaN for a contour of fewer than 3 points or without area.

    Raises:
        InputError: ``count`` is under 1 or above 200.
    """
    if not 1 <= count <= 200:
        raise InputError(f"{count} descriptors", field="count", expected="1 to 200")
    points = np.asarray(contour, np.float64)
    if len(points) < 3:
        return np.full(count, np.nan)
    area = _signed_area(points)
    if abs(area) < 1e-9:
        return np.full(count, np.nan)
    even = _evenly_spaced(points if area > 0 else points[::-1])
    coefficients = np.abs(np.fft.fft(even[:, 0] + 1j * even[:, 1]))
    numbers = np.arange(count)
    frequencies = np.where(numbers % 2 == 0, -(numbers // 2 + 1), numbers // 2 + 2)
    descriptors: Floats = coefficients[frequencies] / coefficients[1]
    return descriptors


def _signed_area(points: Contour) -> float:
    x, y = points.T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _evenly_spaced(points: Contour) -> Contour:
    closed = np.concatenate([points, points[:1]])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.arange(SAMPLES) * (length[-1] / SAMPLES)
    return np.stack([np.interp(at, length, closed[:, axis]) for axis in (0, 1)], axis=1)


def contour_points(mask: Mask, count: int, occlusion: NDArray[Any] | None = None) -> tuple[Contour, Mask]:
    """Take points at even distances along all outlines of a silhouette, those of its holes included.

    Args:
        mask: (H, W), not 0 inside.
        count: How many points.
        occlusion: (H, W), not 0 where something may hide the person; None for nowhere. Its edges, up to 2 px away, may cut the
            silhouette off. Within it, what is seen of the silhouette is before the thing, and ends where the person ends.
            Things that the person may be between have different values, which makes an edge between them.

    Returns:
        (count, 2) points, x and y in px, and (count,) whether each is part of the silhouette's outline: those at the border of
        the image, and at edges of the occlusion, are not; none is, where there is no outline.
    """
    cv2 = opencv()
    inside = (np.asarray(mask) != 0).astype(np.uint8)
    found, _ = cv2.findContours(inside, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    kept = [np.asarray(each, np.float64).reshape(-1, 2) for each in found if cv2.contourArea(each) >= _MIN_AREA]
    if not kept:
        return np.zeros((count, 2)), np.zeros(count, np.uint8)
    pixels = np.concatenate(kept)
    points = pixels[(np.arange(count) * len(pixels)) // count]
    height, width = inside.shape
    column, row = points.T.astype(int)
    seen = (column > 0) & (column < width - 1) & (row > 0) & (row < height - 1)
    if occlusion is not None:
        things, near = np.asarray(occlusion, np.float32), np.ones((5, 5), np.uint8)
        seen &= (cv2.dilate(things, near) == cv2.erode(things, near))[row, column]
    return points, seen.astype(np.uint8)
