"""One camera's frame of a silhouette: contour, maps of the distances to it, and pictures of another size than the camera's."""

from __future__ import annotations

import warnings
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseppl.arrays import Booleans, Floats
from poseppl.checks import check_at_least
from poseppl.errors import InputError
from poseppl.motion.io import CameraRecord
from poseppl.motion.io.opencv import opencv
from poseppl.motion.io.synchronised import VideoWarning
from poseppl.motion.vision import EdgeSettings, check_mask, edge_distance, find_edges, silhouette_distance
from poseppl.motion.vision.contours import contour_points

Mask = NDArray[np.uint8]
OnFailure = Literal["continue", "stop"]
_NEXT = 5.0
"""Distances from an edge are cut off at so many px of the map."""


class SilhouetteSettings(NamedTuple):
    """How silhouettes are turned into data.

    Attributes:
        num_points: K, points on each camera's contour.
        noise: Standard deviation of the contour's distances at the body, mm: of what the flesh, the clothes and the
            segmentation do not agree on, raised because neighbouring points err alike.
        map_size: The longer side of a distance map, px; images are reduced to it.
        truncation: Distances are cut off at so many px of the map.
        edges: Whether edges within the silhouette count, where there are images.
    """

    num_points: int = 64
    noise: float = 80.0
    map_size: int = 320
    truncation: float = 30.0
    edges: bool = False

    def check(self) -> SilhouetteSettings:
        """Return the settings, or raise ``ValueError`` that names the one that is out of range."""
        check_at_least(8, num_points=self.num_points, map_size=self.map_size)
        check_at_least(1.0, truncation=self.truncation)
        check_at_least(0.1, noise=self.noise)
        return self


class SilhouetteFrame(NamedTuple):
    """Silhouette of one camera in a frame; fields as those of a scene of silhouettes, without frames and cameras."""

    contour: Floats
    on_outline: Mask
    distance: NDArray[np.float32]
    usable: bool
    person: NDArray[np.int8]
    edges: NDArray[np.float32] | None = None


def silhouette_frame(
    mask: NDArray[Any],
    occlusion: NDArray[Any] | None,
    record: CameraRecord,
    number: int,
    settings: SilhouetteSettings,
    on_failure: OnFailure = "continue",
) -> SilhouetteFrame:
    """Take a mask for a silhouette.

    Args:
        mask: (H, W), not 0 on the person.
        occlusion: (H, W), not 0 where something may hide the person; None for nowhere. There, pixels on the person count as
            seen, and others say nothing; see :func:`~poseppl.motion.vision.contours.contour_points` for its edges.
        record: The calibrated camera.
        number: Number of the frame, for messages.
        settings: The settings.
        on_failure: "continue" with a ``VideoWarning`` where the mask is empty or full, or "stop".

    Raises:
        InputError: A mask is of another size than the camera's pictures, or what `on_failure` stops at.
    """
    width, height = record.size
    for what, array in (("mask", mask), ("occlusion mask", occlusion)):
        if array is not None and array.shape != (height, width):
            problem = f"the {what} has {array.shape[-1]} x {array.shape[0]} pixels"
            raise InputError(problem, field=f"camera {record.name}, frame {number}", expected=f"{width} x {height}")
    person = (mask != 0).astype(np.uint8)
    try:
        check_mask(person, record.name, number)
        usable = True
    except InputError as error:
        if on_failure == "stop":
            raise
        warnings.warn(f"{error}; the camera does not count in this frame", VideoWarning, stacklevel=3)
        usable = False
    contour, on_outline = contour_points(person, settings.num_points, occlusion)
    blind = np.zeros_like(person) if occlusion is None else (occlusion != 0).astype(np.uint8)
    scale = map_scale(record, settings)
    size = (round(width * scale), round(height * scale))
    small, blind, seen = (_reduced(each, size) for each in (person | blind, blind, person))
    distance = silhouette_distance(small.astype(np.uint8), settings.truncation) / np.float32(scale)
    labels = np.where(seen, 1, np.where(blind, -1, 0)).astype(np.int8)
    return SilhouetteFrame(contour, on_outline if usable else 0 * on_outline, distance.astype(np.float32), usable, labels)


def _reduced(mask: Mask, size: tuple[int, int]) -> Booleans:
    """A mask of zeros and ones at another size (width, height)."""
    return np.asarray(opencv().resize(mask * np.uint8(255), size, interpolation=opencv().INTER_AREA) > 127)


def map_scale(record: CameraRecord, settings: SilhouetteSettings) -> float:
    """Pixels of a distance map to one of the image."""
    return min(1.0, settings.map_size / max(record.size))


def edge_map(image: NDArray[np.uint8], foreground: Mask, scale: float) -> NDArray[np.float32]:
    """Distances to the nearest edge of the foreground, at the scale of the maps, px of the image."""
    distance = edge_distance(find_edges(image, EdgeSettings(), foreground), _NEXT / scale)
    size = (round(distance.shape[1] * scale), round(distance.shape[0] * scale))
    return np.asarray(opencv().resize(distance, size, interpolation=opencv().INTER_AREA), np.float32)


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
