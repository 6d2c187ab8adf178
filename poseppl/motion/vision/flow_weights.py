r"""How far a flow can be believed, in which direction: weight matrices of its vectors.

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
from poseppl.motion.vision.edges import gray
from poseppl.motion.vision.flow import Flow
from poseppl.motion.vision.masks import Mask

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
