"""A calibrated camera, and the checks of its fields that all readers of calibrations share."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from poseppl.arrays import Floats
from poseppl.errors import Location, brief
from poseppl.motion.io.motion import z_up
from poseppl.motion.io.text_parsing import LARGEST

MAX_CAMERAS = 1000


Field = tuple[Location, Any]
"""Position of a field, and its value."""


class CameraRecord(NamedTuple):
    """A calibrated camera.

    Attributes:
        name: Its name.
        matrix: (3, 3) intrinsic matrix in pixels.
        distortion: (5,) k1, k2, p1, p2, k3, or (8,) with k4, k5, k6 of the rational model; (4,) k1, k2, k3, k4 of a fisheye.
        rotation: (3, 3) world axes to camera axes.
        translation: (3,) mm; a world point x is at R x + t in the camera's axes.
        size: Width and height of the image in pixels.
        fisheye: Whether the lens is a fisheye, as OpenCV's module of that name has it.
    """

    name: str
    matrix: Floats
    distortion: Floats
    rotation: Floats
    translation: Floats
    size: tuple[int, int]
    fisheye: bool = False


class Calibration(NamedTuple):
    """The cameras of a file.

    Attributes:
        cameras: The cameras; where the unit is unknown, its lengths are taken for metres.
        unit: Length of a unit of the file; None if the file does not state it.
        up: The axis of the file that points up, if the user chose it: Z is up in ``cameras`` then.
    """

    cameras: tuple[CameraRecord, ...]
    unit: str | None
    up: str | None = None


def camera_of_fields(
    name: str, *, matrix: Field, distortion: Field, rotation: Field, translation: Field, size: Field, fisheye: bool = False
) -> CameraRecord:
    """Check the fields of a camera.

    Args:
        name: Its name.
        matrix: Intrinsic matrix.
        distortion: Coefficients.
        rotation: World axes to camera axes, a matrix or a vector (Rodrigues).
        translation: In the file's unit of length, which is not looked at.
        size: Width and height.
        fisheye: Whether the coefficients are those of a fisheye.

    Raises:
        InputError: One of them is malformed.
    """
    extent = image_size(*size)
    turn, place = rotation_matrix(*rotation), vector(*translation)
    if place.shape != (3,):
        raise translation[0].error(f"{place.size} values", "3 numbers")
    return CameraRecord(name, intrinsics(*matrix), coefficients(*distortion, fisheye), turn, place, extent, fisheye)


def scaled(camera: CameraRecord, mm: float) -> CameraRecord:
    """A camera whose lengths are so many mm each."""
    return camera._replace(translation=np.asarray(camera.translation * mm))


def with_size(camera: CameraRecord, size: tuple[int, int]) -> CameraRecord:
    """The camera of pictures that were resized to another width and height, px."""
    share = np.array(size) / camera.size
    grow = np.array([[share[0], 0.0, (share[0] - 1) / 2], [0.0, share[1], (share[1] - 1) / 2], [0.0, 0.0, 1.0]])
    return camera._replace(matrix=np.asarray(grow @ camera.matrix), size=size)


def with_z_up(camera: CameraRecord, up: str) -> CameraRecord:
    """A camera in a world turned so that Z is up, of one with another axis up (:func:`~poseppl.motion.io.motion.z_up`)."""
    return camera._replace(rotation=z_up(camera.rotation, up))


def vector(at: Location, value: object) -> Floats:
    """Numbers of a list, or of a matrix of one row or column."""
    column = isinstance(value, list) and bool(value) and all(isinstance(row, list) and len(row) == 1 for row in value)
    return numbers(at, [row[0] for row in value] if column else value, 1)  # type: ignore[attr-defined]


def numbers(at: Location, value: object, rank: int) -> Floats:
    """An array of finite numbers with so many levels of brackets; of a camera that may move but does not, one frame.

    Raises:
        InputError: It is none.
    """
    if value is None:
        raise at.error("the field is missing")
    depth, inner = 0, value
    while isinstance(inner, list) and inner:
        depth, inner = depth + 1, inner[0]
    if depth == rank + 1 and isinstance(value, list):
        # A camera that may move has one entry a frame; ours stands still.
        if any(entry != value[0] for entry in value):
            raise at.error("the camera moves", "a static camera")
        value = value[0]
    try:
        array = np.array(value)
    except (ValueError, OverflowError, TypeError) as error:
        raise at.error("not an array of numbers") from error
    if array.ndim != rank or (array.size and array.dtype.kind not in "if"):
        raise at.error("not an array of numbers", f"{rank} level(s) of brackets")
    array = array.astype(np.float64)
    if not np.all(np.abs(array) <= LARGEST):
        raise at.error("not finite, or too large", "at most 1e9")
    return array


def image_size(at: Location, value: object) -> tuple[int, int]:
    """Two extents of a picture in pixels."""
    size = vector(at, value)
    if size.shape != (2,) or np.any(size < 1) or np.any(size != np.round(size)):
        raise at.error(f"{brief(size.tolist())}", "[width, height] in pixels")
    return int(size[0]), int(size[1])


def coefficients(at: Location, value: object, fisheye: bool) -> Floats:
    """Distortion coefficients, as :class:`CameraRecord` has them; more than eight are taken if they are 0."""
    found = vector(at, value)
    if fisheye:
        if found.size != 4 and np.any(found[4:]):
            raise at.error(f"{found.size} coefficients", "k1 k2 k3 k4 of a fisheye")
        return np.pad(found[:4], (0, 4 - found[:4].size))
    if found.size > 8 and not np.any(found[8:]):
        found = found[:8]  # OpenCV's thin prism and tilt, unused
    if found.size not in (0, 1, 2, 3, 4, 5, 8):
        raise at.error(f"{found.size} coefficients", "k1 k2 p1 p2 k3, or these and k4 k5 k6")
    return np.pad(found, (0, max(0, 5 - found.size)))


def intrinsics(at: Location, value: object) -> Floats:
    """An intrinsic matrix."""
    matrix = numbers(at, value, 2)
    expected = "[[fx, skew, cx], [0, fy, cy], [0, 0, 1]] with fx, fy > 0"
    if matrix.shape != (3, 3) or not np.allclose(matrix[[1, 2, 2, 2], [0, 0, 1, 2]], [0, 0, 0, 1]):
        raise at.error("not an intrinsic matrix", expected)
    if matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        raise at.error("a focal length is not positive", expected)
    return matrix


def rotation_matrix(at: Location, value: object) -> Floats:
    """A rotation, from its matrix or its vector (Rodrigues)."""
    matrix = isinstance(value, list) and len(value) == 3 and all(isinstance(row, list) and len(row) > 1 for row in value)
    if matrix and value != [value[0]] * 3:  # type: ignore[index]
        found = numbers(at, value, 2)
        if found.shape != (3, 3) or not np.allclose(found @ found.T, np.eye(3), atol=1e-4):
            raise at.error("not a rotation matrix", "orthonormal rows")
        if np.linalg.det(found) < 0:
            raise at.error("a reflection", "a right-handed rotation")
        return found
    if matrix and not np.any(numbers(at, value, 1)):
        expected = "a 3 x 3 matrix of orthonormal rows, or one rotation vector"
        raise at.error("zeros are no rotation matrix", expected)
    turn = vector(at, value)
    if turn.shape != (3,) or np.linalg.norm(turn) > 100.0:
        raise at.error("not a rotation", "a rotation vector or a 3 x 3 matrix")
    return np.asarray(Rotation.from_rotvec(turn).as_matrix())
