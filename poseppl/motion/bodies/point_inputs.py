"""The inputs of programs of named points in cameras (``poseppl_models.bodies.named_points``), which the tracker makes."""

from __future__ import annotations

from typing import Any, NamedTuple


class PointInputs(NamedTuple):
    """Inputs of the programs at one frame, of K points in C cameras with L links.

    Attributes:
        cameras: The cameras.
        magnification: (C,) pixels that a unit of length has at the points.
        window: (C, 2) width and height of the pictures.
        logit: (C, K) of the detector's confidence.
        elapsed: Seconds () since the frame before.
        freedom: Degrees of freedom () of the errors that do not last.
        start: (K, 3) about where the points are at first.
        start_scale: Standard deviation () of that.
        length: (L,) prior mean of the links' lengths.
        length_scale: (L,) its standard deviation.
        tolerance: (L,) standard deviation of a distance around its length.
    """

    cameras: Any
    magnification: Any
    window: Any
    logit: Any
    elapsed: Any
    freedom: Any
    start: Any
    start_scale: Any
    length: Any
    length_scale: Any
    tolerance: Any
