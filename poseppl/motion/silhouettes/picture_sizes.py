"""Pictures whose size is not quite that of the camera."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from poseppl.errors import InputError
from poseppl.motion.io import CameraRecord
from poseppl.motion.io.opencv import opencv
from poseppl.motion.io.synchronised import VideoWarning

Image = NDArray[np.uint8]
_CUT = 0.02
"""Share of a picture's width or height that an encoder may cut off."""
_BLOCK = 16
"""Side in px of the blocks that an encoder pads to."""


def fit_size(record: CameraRecord, size: tuple[int, int]) -> CameraRecord:
    """The record of a camera whose pictures have another width and height, px, than its calibration says.

    Encoders cut off a few of the last columns or rows, or pad to whole blocks. Such pictures are used unchanged, with a
    ``VideoWarning``.

    Raises:
        InputError: They differ by more.
    """
    if size == record.size:
        return record
    sizes = f"the pictures have {size[0]} x {size[1]} pixels, the calibration {record.size[0]} x {record.size[1]}"
    if not all((1 - _CUT) * whole <= side < whole + _BLOCK for side, whole in zip(size, record.size, strict=True)):
        expected = "pictures of the calibrated size; scale the videos, or the calibration's size and matrix"
        raise InputError(sizes, field=f"camera {record.name}", expected=expected)
    how = "padding" if any(side > whole for side, whole in zip(size, record.size, strict=True)) else "cut off"
    warnings.warn(
        f"camera {record.name}: {sizes}; the last columns or rows are assumed to be {how}", VideoWarning, stacklevel=3
    )
    return record._replace(size=size)


def resized(picture: Image, size: tuple[int, int], what: str, camera: str) -> Image:
    """A picture at a camera's width and height, px, of which it may be smaller or larger but not of another shape.

    Args:
        picture: (H, W) or (H, W, 3).
        size: Width and height that are wanted.
        what: The picture, for messages.
        camera: The camera, for messages.

    Raises:
        InputError: It has another shape.
    """
    (width, height), (wide, high) = size, picture.shape[1::-1]
    if (wide, high) == (width, height):
        return picture
    if abs(wide * height - high * width) > _CUT * wide * height:
        problem = f"the {what} has {wide} x {high} pixels"
        raise InputError(problem, field=f"camera {camera}", expected=f"{width} x {height}, or the same shape smaller")
    how = opencv().INTER_CUBIC if width > wide else opencv().INTER_AREA
    return np.asarray(opencv().resize(picture, (width, height), interpolation=how), np.uint8)
