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

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location
from poseppl.motion.io.camera_fields import (
    MAX_CAMERAS,
    CameraRecord,
    coefficients,
    image_size,
    intrinsics,
    rotation,
    translation,
)
from poseppl.motion.io.opencv_yaml import read_opencv_yaml
from poseppl.motion.io.text_parsing import some

_MATRIX = ("camera_matrix", "cameraMatrix", "K", "M", "intrinsic_matrix", "mtx")
_DISTORTION = ("distortion_coefficients", "dist_coeffs", "distCoeffs", "D", "dist")
_ROTATION = ("R", "rotation", "rotation_matrix", "rvec")
_TRANSLATION = ("T", "t", "translation", "tvec")
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
        turn = _first(outer, (f"Rot_{name}", f"R_{name}"), there)
        size = (inner.get(f"W_{name}"), inner.get(f"H_{name}"))
        cameras.append(
            _camera(
                name,
                _first(inner, (f"K_{name}",), at),
                _first(inner, (f"dist_{name}", f"D_{name}"), at, optional=True),
                turn,
                _first(outer, (f"T_{name}",), there),
                None if None in size else list(size),
            )
        )
    return tuple(cameras)


def read_opencv_camera(path: FilePath) -> CameraRecord:
    """Read one camera of OpenCV's YAML, named after its file.

    Raises:
        InputError: The file is malformed, or a field is missing.
    """
    fields, at = read_opencv_yaml(path), Location(path)
    width = next((fields[key] for key in ("image_width", "imageWidth", "width") if key in fields), None)
    height = next((fields[key] for key in ("image_height", "imageHeight", "height") if key in fields), None)
    size = fields.get("image_size") if width is None or height is None else [width, height]
    fisheye = fields.get("fisheye", fields.get("model")) in (1, "true", "fisheye", "True")
    return _camera(
        Path(path).stem,
        _first(fields, _MATRIX, at),
        _first(fields, _DISTORTION, at, optional=True),
        _first(fields, _ROTATION, at),
        _first(fields, _TRANSLATION, at),
        None if size is None else list(np.ravel(np.array(size, object))),
        fisheye,
    )


_Field = tuple[Location, Any]


def _first(fields: Mapping[str, Any], names: tuple[str, ...], at: Location, optional: bool = False) -> _Field:
    for name in names:
        if name in fields:
            return at.in_field(name), fields[name]
    if optional:
        return at.in_field(names[0]), []
    raise at.in_field(names[0]).error("the field is missing", f"{some(names)}; found {some(fields)}")


def _camera(
    name: str, matrix: _Field, lens: _Field, turn: _Field, place: _Field, size: list[Any] | None, fisheye: bool = False
) -> CameraRecord:
    inner = intrinsics(*matrix)
    extent = [float(round(2 * inner[axis, 2])) for axis in (0, 1)] if size is None else size
    return CameraRecord(
        name=name,
        matrix=inner,
        distortion=coefficients(lens[0], _flat(lens[1]), fisheye),
        rotation=rotation(turn[0], turn[1] if _is_square(turn[1]) else _flat(turn[1])),
        translation=translation(place[0], _flat(place[1])),
        size=image_size(matrix[0].in_field("image_width, image_height"), extent),
        fisheye=fisheye,
    )


def _is_square(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 3 and all(isinstance(row, list) and len(row) == 3 for row in value)


def _flat(value: Any) -> list[Any]:
    """A row or column of a matrix as a list."""
    rows = value if isinstance(value, list) else [value]
    return [entry for row in rows for entry in (row if isinstance(row, list) else [row])]


def scaled(camera: CameraRecord, mm: float) -> CameraRecord:
    """A camera whose lengths are so many mm each."""
    moved: Floats = camera.translation * mm
    return camera._replace(translation=moved)
