"""Foreground masks: cleaned by morphology and by area, refused where they say nothing, and the part of an image they fill."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from poseppl.motion.io.opencv import opencv, place

Mask = NDArray[np.uint8]
_SMALL = 320
"""Connected regions are found at a longer side of at most so many px."""
_MIN_SHARE, _MAX_SHARE = 1e-4, 0.9
"""Shares of foreground between which a mask is informative."""


def clean_mask(mask: Mask, *, opening: int = 3, closing: int = 7, min_area: int = 400, largest_hole: int = 100) -> Mask:
    """Remove specks, close gaps, remove small regions and fill small holes, in this order.

    Args:
        mask: (H, W) uint8, 0 or 1.
        opening: Diameter in px of the disc that removes specks; 0 for none.
        closing: Diameter in px of the disc that closes gaps; 0 for none.
        min_area: Regions of fewer px are removed.
        largest_hole: Holes of at most this many px are filled.

    Returns:
        (H, W) uint8, 0 or 1.
    """
    opened = _morphology("MORPH_OPEN", mask, opening)
    cleaned = np.zeros_like(opened)
    part = window(opened, closing + 1)
    if part is not None:
        closed = _without_small(_morphology("MORPH_CLOSE", opened[part], closing), min_area, 8)
        cleaned[part] = 1 - _without_small(1 - closed, largest_hole + 1, 4)
    return cleaned


def keep_together(mask: Mask, reach: float, passable: Mask | None = None) -> Mask:
    """Keep the largest region and those near it: one person, of whom parts are missed or hidden.

    Args:
        mask: (H, W) uint8, 0 or 1.
        reach: How far the next region may be, of the square root of the largest one's area; from region to region.
        passable: (H, W), not 0 where the person may go on unseen, behind furniture: regions at its two sides are together.

    Returns:
        (H, W) uint8, 0 or 1.
    """
    cv2 = opencv()
    scale = min(1.0, _SMALL / max(mask.shape))
    size = (max(1, round(mask.shape[1] * scale)), max(1, round(mask.shape[0] * scale)))
    small = (cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0).astype(np.uint8)
    _, labels, regions, _ = cv2.connectedComponentsWithStats(small, connectivity=8)
    if len(regions) <= 2:
        return mask
    largest = 1 + int(np.argmax(regions[1:, -1]))
    grown = cv2.distanceTransform(1 - small, cv2.DIST_L2, 3) <= reach * np.sqrt(regions[largest, -1]) / 2
    if passable is not None:
        grown |= cv2.resize(np.asarray(passable, np.uint8), size, interpolation=cv2.INTER_NEAREST) != 0
    _, groups = cv2.connectedComponents(grown.astype(np.uint8), connectivity=8)
    kept = (groups == groups[labels == largest][0]).astype(np.uint8)
    together: Mask = mask * cv2.resize(kept, mask.shape[1::-1], interpolation=cv2.INTER_NEAREST)
    return together


def check_mask(mask: Mask, camera: str, frame: int) -> None:
    """Refuse a foreground mask that says nothing: nobody in it, or everything.

    A caller may catch the error and go on with that camera as ignored in this frame.

    Args:
        mask: (H, W), not 0 at the foreground.
        camera: The camera.
        frame: The frame number.

    Raises:
        InputError: The mask is empty or full, or nearly so.
    """
    share = float(np.count_nonzero(mask)) / max(mask.size, 1)
    if _MIN_SHARE <= share <= _MAX_SHARE:
        return
    kind = "all black: no foreground" if share == 0 else "all white: no background" if share == 1 else f"{share:.2%} foreground"
    shares = f"{_MIN_SHARE:.2%} to {_MAX_SHARE:.0%} foreground"
    expected = f"{shares}; look at the background plate and the threshold, or mask this camera out"
    raise place(camera, frame).error(f"the foreground mask is {kind}", expected)


def _morphology(operation: str, mask: Mask, diameter: int) -> Mask:
    cv2 = opencv()
    if diameter <= 1:
        return mask
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (diameter, diameter))
    changed: Mask = cv2.morphologyEx(mask, getattr(cv2, operation), disc)
    return changed


def _without_small(mask: Mask, min_area: int, connectivity: int) -> Mask:
    if min_area <= 1:
        return mask
    _, labels, regions, _ = opencv().connectedComponentsWithStats(mask, connectivity=connectivity)
    kept = regions[:, -1] >= min_area
    kept[0] = False
    cleaned: Mask = kept.astype(np.uint8)[labels]
    return cleaned


Window = tuple[slice, slice]


def window(mask: NDArray[np.uint8], margin: float) -> Window | None:
    """Find the smallest rectangle with all marked pixels.

    Args:
        mask: (H, W) uint8, not 0 where marked.
        margin: By how many px the rectangle is widened, within the image.

    Returns:
        Rows and columns; None where nothing is marked.
    """
    left, top, width, height = opencv().boundingRect(mask)
    if width == 0:
        return None
    more = int(np.ceil(margin))
    return slice(max(top - more, 0), top + height + more), slice(max(left - more, 0), left + width + more)
