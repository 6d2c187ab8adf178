"""Image cues of Sminchisescu and Triggs (2001, section 3.1): edge energy, motion boundaries, and weights of a flow's vectors.

"The images are smoothed with a Gaussian kernel, contrast normalized, and a Sobel edge detector is applied": gray levels are
divided by their standard deviation in a window, so that an edge in the shade counts as much as one in the light. The paper
gives no widths and no normalisation. Here the smoothing has 2 px, the window has 20 px, and a floor of 6 gray levels keeps flat
walls flat. The magnitude m of the gradient becomes m^2 / (m^2 + m_0^2), from 0 to 1. With less smoothing and a lower floor, the
grain of a wall has half the energy of a silhouette. A search along a normal then finds edges everywhere.

A motion boundary is where the flow cannot be believed (:mod:`poseppl.motion.vision.flow`), or where it changes from one pixel
to the next, smoothed likewise: between an arm and what is behind it, both.

Flow is a guess on a wall or a limb of one colour. It is also a guess along a limb of which only the sides are seen:
the aperture problem. With the structure tensor S of the image, gradients averaged over a window, and the noise n of gradients,

    W = w S (S + n^2 I)^-1,    w = exp(-(I_2(x + v) - I_1(x))^2 / (2 q^2)),

has an eigenvalue near 1 across strong edges and near 0 along them; w falls where the pixel differs from the one that
the flow v leads to. This happens where a limb moved farther than the search for flow reaches and got the flow of its
background.
It is 0 where forward and backward flow disagree. Sminchisescu and Triggs (2001, section 3.1) have a positive definite matrix
W_i for each observation without a definition; this one is ours.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseppl.checks import check_at_least
from poseppl.motion.io.opencv import Image, opencv
from poseppl.motion.vision.edges import Map, gray
from poseppl.motion.vision.flow import Flow
from poseppl.motion.vision.masks import Mask


class EnergySettings(NamedTuple):
    """How edge energy is found.

    Attributes:
        smoothing: Standard deviation of the Gaussian before the gradient, px.
        window: Standard deviation of the window in which contrast is measured, px.
        floor: Standard deviation of gray levels below which a window counts as flat.
        half: Gradient of half energy, windows' standard deviations a px.
        boundary: Standard deviation of the Gaussian that smooths motion boundaries, px.
        change: Change of the flow (px a px) that is half of a motion boundary.
    """

    smoothing: float = 2.0
    window: float = 20.0
    floor: float = 6.0
    half: float = 0.12
    boundary: float = 3.0
    change: float = 1.0

    def at_level(self, level: float) -> EnergySettings:
        """The settings of a coarser level of a pyramid: so many times the smoothing, in wider windows."""
        root = level**0.5
        return self._replace(smoothing=level * self.smoothing, window=root * self.window, half=self.half / root)

    def check(self) -> EnergySettings:
        """Return the settings, or raise ``ValueError`` that names the one that is out of range."""
        check_at_least(0.3, smoothing=self.smoothing, window=self.window, boundary=self.boundary)
        check_at_least(1e-3, floor=self.floor, half=self.half, change=self.change)
        return self


def edge_energy(image: Image, settings: EnergySettings | None = None) -> Map:
    """Measure the edges of an image.

    Args:
        image: (H, W, 3) RGB or (H, W) gray.
        settings: The settings.

    Returns:
        (H, W) in [0, 1).
    """
    cv2, chosen = opencv(), (settings or EnergySettings()).check()
    smooth = cv2.GaussianBlur(gray(image).astype(np.float32), (0, 0), chosen.smoothing)
    mean = cv2.GaussianBlur(smooth, (0, 0), chosen.window)
    variance = cv2.GaussianBlur(np.square(smooth - mean), (0, 0), chosen.window)
    normal = (smooth - mean) / np.sqrt(variance + np.float32(chosen.floor**2))
    right, down = (cv2.Sobel(normal, cv2.CV_32F, *way, ksize=3, scale=0.125) for way in ((1, 0), (0, 1)))
    squared = right * right + down * down
    energy: Map = squared / (squared + np.float32(chosen.half**2))
    return energy


def motion_boundaries(outliers: Mask, flow: Flow | None = None, settings: EnergySettings | None = None) -> Map:
    """Smooth the outliers of a flow, and where it changes, into motion boundaries.

    Args:
        outliers: (H, W) uint8, 1 where the flow cannot be believed.
        flow: (H, W, 2) px; None for outliers alone.
        settings: The settings.

    Returns:
        (H, W) in [0, 1].
    """
    cv2, chosen = opencv(), (settings or EnergySettings()).check()
    boundary = outliers.astype(np.float32)
    if flow is not None:
        slopes = [cv2.Sobel(flow[..., i], cv2.CV_32F, *way, ksize=3, scale=0.125) for i in (0, 1) for way in ((1, 0), (0, 1))]
        squared = np.sum(np.square(slopes), axis=0)
        boundary = np.maximum(boundary, squared / (squared + np.float32(chosen.change**2)))
    boundaries: Map = cv2.GaussianBlur(boundary, (0, 0), chosen.boundary)
    return boundaries


_TINY = 1e-9


class WeightSettings(NamedTuple):
    """How flow is weighed.

    Attributes:
        noise: n, gray levels a px.
        window: Standard deviation of the window of the structure tensor, px.
        difference: q, gray levels, of images smoothed by 1.5 px.
    """

    noise: float = 4.0
    window: float = 3.0
    difference: float = 15.0

    def check(self) -> WeightSettings:
        """Return the settings, or raise ``ValueError`` that names the one that is out of range."""
        check_at_least(1e-3, noise=self.noise, difference=self.difference)
        check_at_least(0.3, window=self.window)
        return self


def flow_weights(
    before: Image, after: Image, flow: Flow, outliers: Mask, settings: WeightSettings | None = None
) -> NDArray[np.float32]:
    """Weigh a flow.

    Args:
        before: (H, W, 3) RGB or (H, W) gray.
        after: The frame to which the flow leads.
        flow: (H, W, 2) px, from ``before`` to ``after``.
        outliers: (H, W) uint8, 1 where it is not believed at all.
        settings: The settings.

    Returns:
        Symmetric roots of the weight matrices (3, H, W): xx, xy and yy, eigenvalues from 0 to 1.
    """
    cv2, chosen = opencv(), (settings or WeightSettings()).check()
    smooth = cv2.GaussianBlur(gray(before).astype(np.float32), (0, 0), 1.0)
    x, y = (cv2.Sobel(smooth, cv2.CV_32F, *way, ksize=3, scale=0.125) for way in ((1, 0), (0, 1)))
    xx, xy, yy = (cv2.GaussianBlur(each, (0, 0), chosen.window) for each in (x * x, x * y, y * y))
    middle, half = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    most, least = (np.sqrt(value / (value + chosen.noise**2)) for value in (middle + half, np.maximum(middle - half, 0.0)))
    alike = 0.5 * (most + least)
    turned = 0.5 * (most - least) / np.maximum(half, _TINY)
    roots = np.stack([alike + turned * 0.5 * (xx - yy), turned * xy, alike - turned * 0.5 * (xx - yy)])
    believed = np.sqrt(_likeness(before, after, flow, chosen.difference)) * (1 - outliers)
    weights: NDArray[np.float32] = (roots * believed).astype(np.float32)
    return weights


def _likeness(before: Image, after: Image, flow: Flow, difference: float) -> NDArray[np.float32]:
    """The factor w (H, W) of the weights."""
    cv2 = opencv()
    first, second = (cv2.GaussianBlur(gray(image).astype(np.float32), (0, 0), 1.5) for image in (before, after))
    height, width = first.shape
    x = np.arange(width, dtype=np.float32)[None, :] + flow[..., 0]
    y = np.arange(height, dtype=np.float32)[:, None] + flow[..., 1]
    there = cv2.remap(second, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    likeness: NDArray[np.float32] = np.exp(-0.5 * ((there - first) / np.float32(difference)) ** 2)
    return likeness
