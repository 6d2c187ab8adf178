"""Dense optical flow between two frames, and where it cannot be believed.

Sminchisescu and Triggs (2001, section 3.1) weight edges by the outlier map of a robust flow, which shows motion boundaries.
Here outliers are pixels where the flow forth and back does not return to its start (Sundaram, Brox and Keutzer 2010,
doi:10.1007/978-3-642-15549-9_32, equation 5): what is hidden in the other frame has no counterpart there.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseppl.checks import check_at_least, check_fraction
from poseppl.errors import InputError
from poseppl.motion.io.opencv import Image, opencv
from poseppl.motion.vision.edges import gray
from poseppl.motion.vision.masks import Mask, window

Flow = NDArray[np.float32]


class FlowSettings(NamedTuple):
    """How flow is found.

    Attributes:
        method: "dis", dense inverse search (Kroeger et al. 2016) at one of three speeds, or "farneback" (2003).
        relative: How far a pixel may miss its start, squared, as a share of the squared lengths of its way forth and back.
        absolute: How far it may miss besides, px squared.
        margin: Flow is sought in the rectangle of the foreground, widened by so many px.
    """

    method: Literal["dis_ultrafast", "dis_fast", "dis_medium", "farneback"] = "dis_ultrafast"
    relative: float = 0.01
    absolute: float = 0.5
    margin: int = 32

    def check(self) -> FlowSettings:
        """Refuse settings that cannot be used.

        Returns:
            The settings.

        Raises:
            ValueError: The method is unknown, or a number out of its range.
        """
        if self.method not in ("dis_ultrafast", "dis_fast", "dis_medium", "farneback"):
            raise ValueError(f"method is {self.method!r}. Expected 'dis_ultrafast', 'dis_fast', 'dis_medium' or 'farneback'.")
        check_fraction("[0, 1]", relative=self.relative)
        check_at_least(0, absolute=self.absolute, margin=self.margin)
        return self


def dense_flow(before: Image, after: Image, method: str = "dis_ultrafast") -> Flow:
    """Find where each pixel of a frame has moved to in another.

    Args:
        before: (H, W, 3) RGB or (H, W) gray.
        after: The other frame, of the same size.
        method: As in ``FlowSettings``.

    Returns:
        (H, W, 2) px to the right and downwards.

    Raises:
        InputError: The frames differ in size, or a side is under 16 px.
    """
    cv2 = opencv()
    first, second = gray(before), gray(after)
    if first.shape != second.shape or min(first.shape) < 16:
        raise InputError(f"frames of shapes {first.shape} and {second.shape}", expected="two of one size, 16 px at least")
    if method == "farneback":
        expansion: Flow = cv2.calcOpticalFlowFarneback(first, second, None, 0.5, 4, 21, 3, 7, 1.5, 0)
        return expansion
    preset = {"dis_ultrafast": "ULTRAFAST", "dis_fast": "FAST", "dis_medium": "MEDIUM"}[method]
    search = cv2.DISOpticalFlow_create(getattr(cv2, f"DISOPTICAL_FLOW_PRESET_{preset}"))
    flow: Flow = search.calc(first, second, None)
    return flow


def flow_outliers(forth: Flow, back: Flow, settings: FlowSettings | None = None) -> Mask:
    """Mark the pixels that do not return to their start: |f + b|^2 > relative (|f|^2 + |b|^2) + absolute.

    Args:
        forth: (H, W, 2) flow f from the first frame to the second, px.
        back: (H, W, 2) flow from the second to the first; b is taken where f ends.
        settings: The limits.

    Returns:
        (H, W) uint8, 1 where the flow cannot be believed, among them all pixels that leave the image.
    """
    cv2, chosen = opencv(), (settings or FlowSettings()).check()
    height, width = forth.shape[:2]
    x = np.arange(width, dtype=np.float32)[None, :] + forth[..., 0]
    y = np.arange(height, dtype=np.float32)[:, None] + forth[..., 1]
    returning = cv2.remap(back, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    # Planes in one piece: sums over a last axis of length 2 take five times as long.
    (u, v), (s, t) = cv2.split(forth), cv2.split(returning)
    miss = np.square(u + s) + np.square(v + t)
    allowed = np.float32(chosen.relative) * (u * u + v * v + s * s + t * t) + np.float32(chosen.absolute)
    outside = (x < 0) | (x > width - 1) | (y < 0) | (y > height - 1)
    outliers: Mask = ((miss > allowed) | outside).view(np.uint8)
    return outliers


def foreground_flow(before: Image, after: Image, foreground: Mask, settings: FlowSettings | None = None) -> tuple[Flow, Mask]:
    """Find the flow around the foreground, and where it cannot be believed; the rest of the frame is not looked at.

    Args:
        before: (H, W, 3) RGB or (H, W) gray, 16 px at least.
        after: The frame of the foreground.
        foreground: (H, W) uint8, 1 at the foreground.
        settings: The settings.

    Returns:
        (H, W, 2) px from ``before`` to ``after``, and (H, W) uint8, 1 where it cannot be believed; 0 and 1 beyond the margin.
    """
    chosen = (settings or FlowSettings()).check()
    flow, outliers = np.zeros((*foreground.shape, 2), np.float32), np.ones(foreground.shape, np.uint8)
    part = window(foreground, max(chosen.margin, 16))
    if part is not None:
        first, second = gray(before)[part], gray(after)[part]
        flow[part] = dense_flow(first, second, chosen.method)
        outliers[part] = flow_outliers(flow[part], dense_flow(second, first, chosen.method), chosen)
    return flow, outliers
