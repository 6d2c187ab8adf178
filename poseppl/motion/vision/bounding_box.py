"""The part of an image that a mask takes up: work on a silhouette need not touch the rest of the frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from poseppl.motion.io.opencv import opencv

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
