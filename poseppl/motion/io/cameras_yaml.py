"""Calibrations in OpenCV's YAML: a file a camera, or EasyMocap's pair ``intri.yml`` and ``extri.yml``.

A camera's own file has ``camera_matrix`` (or ``K``), ``distortion_coefficients`` (``D``), ``image_width``, ``image_height``,
``R`` or ``rvec``, and ``T`` or ``tvec``; the camera goes by the file's name. EasyMocap has ``names``, ``K_1``, ``dist_1`` and
perhaps ``H_1`` and ``W_1`` in the first file, and ``R_1`` (a rotation vector) or ``Rot_1`` (a matrix) and ``T_1`` in the
second. Without a size, the picture is taken for as wide and high as twice the principal point. Lengths have no unit.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from poseppl.errors import FilePath, Location
from poseppl.motion.io.camera_fields import (
    MAX_CAMERAS,
    CameraRecord,
    Field,
    camera_of_fields,
    intrinsics,
)
from poseppl.motion.io.opencv_yaml import read_opencv_yaml
from poseppl.motion.io.text_parsing import some

_MATRIX = ("camera_matrix", "cameraMatrix", "K", "M", "intrinsic_matrix", "mtx")
_DISTORTION = ("distortion_coefficients", "dist_coeffs", "distCoeffs", "D", "dist")
_ROTATION = ("R", "rotation", "rotation_matrix", "rvec")
_TRANSLATION = ("T", "t", "translation", "tvec")
_WIDTH, _HEIGHT = ("image_width", "imageWidth", "width"), ("image_height", "imageHeight", "height")
SUFFIXES = (".yml", ".yaml")


def read_easymocap(intrinsic: FilePath, extrinsic: FilePath) -> tuple[CameraRecord, ...]:
    """Read EasyMocap's pair of files.

    Raises:
        InputError: A file is malformed, or a camera of the first lacks a field.
    """
    inner, outer = read_opencv_yaml(intrinsic), read_opencv_yaml(extrinsic)
    at, there = Location(intrinsic), Location(extrinsic)
    names = inner.get("names", outer.get("names"))
    if not isinstance(names, list) or not 0 < len(names) <= MAX_CAMERAS:
        raise at.in_field("names").error("no list of cameras", 'names: [ "1", "2" ]')
    cameras = []
    for name in map(str, names):
        turn, matrix = _first(outer, (f"Rot_{name}", f"R_{name}"), there), _first(inner, (f"K_{name}",), at)
        camera = camera_of_fields(
            name,
            matrix=matrix,
            distortion=_first(inner, (f"dist_{name}", f"D_{name}"), at, []),
            rotation=turn,
            translation=_first(outer, (f"T_{name}",), there),
            size=_size(matrix, inner.get(f"W_{name}"), inner.get(f"H_{name}")),
        )
        cameras.append(camera)
    return tuple(cameras)


def read_opencv_camera(path: FilePath) -> CameraRecord:
    """Read one camera of OpenCV's YAML, named after its file.

    Raises:
        InputError: The file is malformed, or a field is missing.
    """
    fields, at = read_opencv_yaml(path), Location(path)
    matrix = _first(fields, _MATRIX, at)
    width, height = (_first(fields, names, at, None)[1] for names in (_WIDTH, _HEIGHT))
    stated = at.in_field("image_size"), fields.get("image_size")
    return camera_of_fields(
        Path(path).stem,
        matrix=matrix,
        distortion=_first(fields, _DISTORTION, at, []),
        rotation=_first(fields, _ROTATION, at),
        translation=_first(fields, _TRANSLATION, at),
        size=_size(matrix, width, height) if stated[1] is None or None not in (width, height) else stated,
        fisheye=fields.get("fisheye", fields.get("model")) in (1, "true", "fisheye", "True"),
    )


def _first(fields: Mapping[str, Any], names: tuple[str, ...], at: Location, *default: Any) -> Field:
    """The first of these fields that there is; where there is none, the default."""
    for name in names:
        if name in fields:
            return at.in_field(name), fields[name]
    if default:
        return at.in_field(names[0]), default[0]
    raise at.in_field(names[0]).error("the field is missing", f"{some(names)}; found {some(fields)}")


def _size(matrix: Field, width: Any, height: Any) -> Field:
    at = matrix[0].in_field("image_width, image_height")
    if width is None or height is None:
        inner = intrinsics(*matrix)
        width, height = (float(round(2 * inner[axis, 2])) for axis in (0, 1))
    return at, [width, height]
