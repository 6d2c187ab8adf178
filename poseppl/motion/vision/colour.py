"""Colour histograms of regions, and the Bhattacharyya distance between them.

The histogram is that of Perez et al. (2002, doi:10.1007/3-540-47969-4_44): pixels with colour are counted by hue and
saturation, which light changes little; pixels too dark or too pale to have a hue by their brightness. So a gray image has a
histogram of gray. Du and Guan (2006, section 3) compare the colours of body and image by a weighted Bhattacharyya distance and
leave the formula of the weights to another paper; here the weights of pixels within a region are the caller's.

>>> red, blue = (np.full((8, 8, 3), colour, np.uint8) for colour in ((200, 0, 0), (0, 0, 200)))
>>> both = np.concatenate([red, blue])
>>> first, second = (colour_histogram(colour_bins(image)) for image in (red, both))
>>> print(f"{bhattacharyya_distance(first, second):.3f}")  # they share half: sqrt(1 - sqrt(1/2))
0.541
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseppl.arrays import Floats, Integers
from poseppl.checks import check_at_least, check_fraction
from poseppl.errors import InputError
from poseppl.motion.io.opencv import Image, check_image, opencv

Histogram = NDArray[np.float64]


class ColourSettings(NamedTuple):
    """How colours are counted.

    Attributes:
        hues: Bins of hue.
        saturations: Bins of saturation.
        grays: Bins of brightness for pixels without colour.
        min_saturation: Share of full saturation from which a pixel has a hue.
        min_brightness: Share of full brightness from which a pixel has a hue.
    """

    hues: int = 10
    saturations: int = 10
    grays: int = 10
    min_saturation: float = 0.1
    min_brightness: float = 0.2

    def check(self) -> ColourSettings:
        """Refuse settings that cannot be used.

        Returns:
            The settings.

        Raises:
            ValueError: A number is out of its range.
        """
        check_at_least(1, hues=self.hues, saturations=self.saturations, grays=self.grays)
        check_fraction("(0, 1]", min_saturation=self.min_saturation, min_brightness=self.min_brightness)
        return self

    @property
    def bins(self) -> int:
        """Length of a histogram."""
        return self.hues * self.saturations + self.grays


def colour_bins(image: Image, settings: ColourSettings | None = None) -> Integers:
    """Find the bin of each pixel, from which the histograms of many regions are counted.

    Args:
        image: (H, W, 3) RGB or (H, W) gray.
        settings: The bins; None for the default ones.

    Returns:
        (H, W) numbers of bins: hue by hue its saturations, then the grays.
    """
    chosen = (settings or ColourSettings()).check()
    if image.size == 0:
        return np.zeros(image.shape[:2], np.int64)
    checked = check_image(image)
    if checked.ndim == 2:
        return chosen.hues * chosen.saturations + checked.astype(np.int64) * chosen.grays // 256
    cv2 = opencv()
    hue, saturation, value = np.moveaxis(cv2.cvtColor(checked, cv2.COLOR_RGB2HSV).astype(np.int64), -1, 0)
    has_hue = (saturation >= 255 * chosen.min_saturation) & (value >= 255 * chosen.min_brightness)
    # OpenCV's hue of an 8-bit image is half the angle: 0 to 179.
    coloured = hue * chosen.hues // 180 * chosen.saturations + saturation * chosen.saturations // 256
    without: Integers = chosen.hues * chosen.saturations + value * chosen.grays // 256
    return np.where(has_hue, coloured, without)


def colour_histogram(
    bins: Integers, settings: ColourSettings | None = None, weights: NDArray[np.generic] | None = None
) -> Histogram:
    """Count the colours of a region.

    Args:
        bins: (H, W) bins of an image's pixels, of ``colour_bins``.
        settings: The bins; None for the default ones.
        weights: (H, W) weight of each pixel, at least 0: a mask, or anything softer, such as the distance to the region's
            outline, for pixels there are the least certain to belong to it. None for all pixels alike.

    Returns:
        (bins,) shares that add up to 1; all 0 for a region without weight.

    Raises:
        InputError: The weights are not of the image's size, negative or not finite.
    """
    chosen = settings or ColourSettings()
    if weights is None:
        counts = np.bincount(bins.ravel(), minlength=chosen.bins).astype(np.float64)
    else:
        flat = np.asarray(weights, np.float64)
        if flat.shape != bins.shape or not np.all((flat >= 0) & np.isfinite(flat)):
            raise InputError(f"weights of shape {flat.shape}", expected=f"shape {bins.shape}, finite, none negative")
        used = flat > 0
        counts = np.bincount(bins[used], flat[used], chosen.bins).astype(np.float64)
    total = counts.sum()
    return counts / total if total > 0 else counts


def bhattacharyya_distance(first: Histogram, second: Histogram) -> Floats:
    """Compare histograms: sqrt(1 - sum_b sqrt(p_b q_b)) (Comaniciu et al. 2003, equations 6 and 7).

    Args:
        first: (..., bins) shares p.
        second: (..., bins) shares q.

    Returns:
        (...) in [0, 1]: 0 for equal histograms, 1 for such as share no bin, and 1 where one is empty.
    """
    overlap = np.sqrt(first * second).sum(axis=-1)
    distance: Floats = np.sqrt(np.clip(1.0 - overlap, 0.0, 1.0))
    return distance
