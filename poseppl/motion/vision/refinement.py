"""Foreground completed by colour: graph cuts between what is known of a person and of the scene around it.

Background subtraction loses an arm, or cuts a person in two, where clothes or skin have the colour of the scene behind them.
GrabCut (Rother, Kolmogorov and Blake 2004, doi:10.1145/1015706.1015720), OpenCV's, decides by the colours that are known to be
the person's, by those of the scene near by, and by edges between neighbours. Only pixels that differ from the background at
all, if by less than makes foreground, may join the person; the inside of the mask stays.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from poseppl.motion.io.opencv import Image, opencv
from poseppl.motion.vision.bounding_box import window
from poseppl.motion.vision.masks import Mask

_MARGIN = 0.1
"""How far from the mask a pixel may join it, of the mask's height."""
_SIZE = 320
"""The cut is made at a longer side of at most so many px."""
_NEIGHBOURS = 5
"""Side in px of the square over which differences are averaged, and by which the mask is eroded to its inside."""


def refine_mask(image: Image, background: Image, mask: Mask, noise: float) -> Mask:
    """Complete a foreground mask by colour.

    Args:
        image: (H, W, 3) RGB.
        background: The scene without the person (H, W, 3).
        mask: (H, W) uint8, 0 or 1.
        noise: Pixels that differ from the background by this root mean square, gray levels, may be the person's.

    Returns:
        (H, W) uint8, 0 or 1; an empty mask stays empty.
    """
    tight = window(mask, 0)
    if tight is None:
        return mask
    margin = max(4.0, _MARGIN * (tight[0].stop - tight[0].start))
    part = window(mask, margin)
    height, width = mask[part].shape
    scale = min(1.0, _SIZE / max(height, width))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    cv2 = opencv()
    seen, plain = (cv2.resize(each[part], size, interpolation=cv2.INTER_AREA) for each in (image, background))
    small = cv2.resize(mask[part], size, interpolation=cv2.INTER_NEAREST)
    guess = _guess(seen, plain, small, noise, margin * scale)
    if not (np.any(guess % 2 == 0) and np.any(guess % 2 == 1)):  # colours of one side alone
        return mask
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.setRNGSeed(0)  # its colour models start from a random clustering
    cv2.grabCut(np.ascontiguousarray(seen), guess, None, *models, 1, cv2.GC_INIT_WITH_MASK)
    cut = cv2.resize((guess % 2).astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR) > 0.5
    refined = np.zeros_like(mask)
    refined[part] = cut
    return refined


def _guess(image: Image, background: Image, mask: Mask, noise: float, margin: float) -> NDArray[np.uint8]:
    """Initial labels of a cut: the person (inside the mask), perhaps (its rim), perhaps not (what differs near by), or not."""
    cv2 = opencv()
    difference = np.sum((image.astype(np.float32) - background) ** 2, -1)
    differs = cv2.blur(difference, (_NEIGHBOURS, _NEIGHBOURS)) > image.shape[-1] * noise**2
    away = cv2.distanceTransform(1 - mask, cv2.DIST_L2, 3)
    guess: NDArray[np.uint8] = np.where(differs & (away <= margin), cv2.GC_PR_BGD, cv2.GC_BGD).astype(np.uint8)
    guess[mask > 0] = cv2.GC_PR_FGD
    guess[cv2.erode(mask, np.ones((_NEIGHBOURS, _NEIGHBOURS), np.uint8)) > 0] = cv2.GC_FGD
    return guess
