"""Calibrated cameras as TOML.

Written by us, one table a camera; lengths in mm, ``rotation`` and ``translation`` take world points to the camera's axes
(x right, y down, z forward), x_camera = R x_world + t:

    units = "mm"

    [camera.front]
    size = [1920, 1080]
    matrix = [[1500.0, 0.0, 960.0], [0.0, 1500.0, 540.0], [0.0, 0.0, 1.0]]
    distortion = [0.0, 0.0, 0.0, 0.0, 0.0]
    rotation = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
    translation = [0.0, 1000.0, 5000.0]

Read besides: the tables that anipose and Pose2Sim write, ``[cam_01]`` with ``name``, ``distortions`` and ``rotation`` as a
rotation vector, and those of Caliscope, ``[cameras.0]``, whose ``rotation`` may be a matrix, both in metres unless ``units``
says otherwise. Distortion coefficients are (k1, k2, p1, p2, k3) of
Brown's model, as in OpenCV.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location
from poseppl.files.atomic_writing import write_atomically
from poseppl.files.bounded_reading import read_toml
from poseppl.motion.io.text_parsing import LARGEST, LONGEST, check_distinct

MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
MAX_CAMERAS = 1000


class CameraRecord(NamedTuple):
    """A calibrated camera.

    Attributes:
        name: Its name.
        matrix: (3, 3) intrinsic matrix in pixels.
        distortion: (5,) k1, k2, p1, p2, k3.
        rotation: (3, 3) world axes to camera axes.
        translation: (3,) mm; a world point x is at R x + t in the camera's axes.
        size: Width and height of the image in pixels.
    """

    name: str
    matrix: Floats
    distortion: Floats
    rotation: Floats
    translation: Floats
    size: tuple[int, int]


def read_cameras(path: FilePath) -> tuple[CameraRecord, ...]:
    """Read the cameras of a TOML file.

    Args:
        path: The file, in our own form or anipose's.

    Returns:
        The cameras, in the order of the file.

    Raises:
        InputError: The file is no TOML, holds no camera, or a field is missing or malformed; the message names the field.
    """
    document, at = read_toml(path), Location(path)
    ours = document.get("camera")
    prefix, tables = _tables(document)
    if not tables or len(tables) > MAX_CAMERAS:
        raise at.error("the file holds no camera", "a table [camera.NAME], anipose's [cam_0], or Caliscope's [cameras.0]")
    scale = _scale(at, document, "m" if ours is None else "mm")
    cameras = tuple(
        _camera(at.in_field(f"{prefix}{key}"), key, table, scale, ours is not None) for key, table in tables.items()
    )
    check_distinct([camera.name for camera in cameras], "cameras", at.in_field("name"))
    return cameras


def _tables(document: Mapping[str, Any]) -> tuple[str, Mapping[str, Any]]:
    """The tables of the cameras by name, and what stands before their names."""
    for key in ("camera", "cameras"):
        group = document.get(key)
        if group is not None and not (isinstance(group, dict) and "matrix" in group):
            known = group if isinstance(group, dict) else {}
            # Caliscope keeps those that it was told to leave out, without a place.
            return f"{key}.", known if key == "camera" else {
                name: table for name, table in known.items() if not _ignored(table)
            }
    return "", {key: table for key, table in document.items() if isinstance(table, dict) and "matrix" in table}


def _ignored(table: object) -> bool:
    return isinstance(table, dict) and table.get("ignore") is True


def write_cameras(path: FilePath, cameras: Sequence[CameraRecord]) -> None:
    """Write cameras in our own form, atomically; reading gives the same numbers back.

    Args:
        path: The TOML file.
        cameras: The cameras, each with a name of its own.

    Raises:
        InputError: The file cannot be written.
        PosepplError: The disk is full.
    """
    lines = ['units = "mm"']
    for camera in cameras:
        lines += ["", f"[camera.{quoted(camera.name)}]", f"size = [{camera.size[0]}, {camera.size[1]}]"]
        for field in ("matrix", "distortion", "rotation", "translation"):
            lines.append(f"{field} = {np.asarray(getattr(camera, field), dtype=np.float64).tolist()!r}")
    write_atomically(path, "\n".join(lines) + "\n")


def quoted(text: str) -> str:
    """A TOML string; what is no Unicode, as a file's name may be, becomes question marks."""
    known = text.encode("utf-8", "replace").decode("utf-8")
    return json.dumps(known, ensure_ascii=False).replace("\x7f", "\\u007f")


def _scale(at: Location, document: Mapping[str, Any], default: str) -> float:
    metadata = document.get("metadata")
    units = document.get("units", metadata.get("units", default) if isinstance(metadata, dict) else default)
    if not isinstance(units, str) or units not in MM_PER_UNIT:
        raise at.in_field("units").error(f"{str(units)[:40]!r}", " or ".join(f'"{unit}"' for unit in MM_PER_UNIT))
    return MM_PER_UNIT[units]


def _camera(at: Location, key: str, table: object, scale: float, strict: bool) -> CameraRecord:
    longest = max(map(len, (key, *(table if isinstance(table, dict) else ()))))
    if longest > LONGEST:
        raise at.in_field(str(at.field)[:40]).error(f"a name of {longest} characters", f"at most {LONGEST}")
    if not isinstance(table, dict):
        raise at.error("not a table", f"[{at.field}]")

    def of(field: str) -> Location:
        return at.in_field(f"{at.field}.{field}")

    if table.get("fisheye", False) is not False:
        raise of("fisheye").error("fisheye cameras are not supported", "false")
    known = {"name", "size", "matrix", "distortion", "distortions", "rotation", "translation", "fisheye"}
    unknown = sorted(set(table) - known - {"moving", "framerate"}) if strict else []
    if unknown:
        raise of(unknown[0]).error("unknown field", ", ".join(sorted(known)))
    name = table.get("name", key)
    if not isinstance(name, str) or not 0 < len(name) <= LONGEST:
        raise of("name").error("not a name", f"a text of at most {LONGEST} characters")
    size = _numbers(of("size"), table.get("size"), 1)
    if size.shape != (2,) or np.any(size < 1) or np.any(size != np.round(size)):
        raise of("size").error(f"{size.tolist()[:4]}", "[width, height] in pixels")
    distortion = "distortions" if "distortions" in table else "distortion"
    coefficients = _numbers(of(distortion), table.get(distortion), 1)
    if coefficients.size > 5:
        raise of("distortion").error(f"{coefficients.size} coefficients", "k1 k2 p1 p2 k3")
    translation = _numbers(of("translation"), table.get("translation"), 1)
    if translation.shape != (3,):
        raise of("translation").error(f"{translation.size} values", "3 numbers")
    return CameraRecord(
        name=name,
        matrix=_intrinsics(of("matrix"), table.get("matrix")),
        distortion=np.pad(coefficients, (0, 5 - coefficients.size)),
        rotation=_rotation(of("rotation"), table.get("rotation")),
        translation=translation * scale,
        size=(int(size[0]), int(size[1])),
    )


def _numbers(at: Location, value: object, rank: int) -> Floats:
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


def _intrinsics(at: Location, value: object) -> Floats:
    matrix = _numbers(at, value, 2)
    expected = "[[fx, skew, cx], [0, fy, cy], [0, 0, 1]] with fx, fy > 0"
    if matrix.shape != (3, 3) or not np.allclose(matrix[[1, 2, 2, 2], [0, 0, 1, 2]], [0, 0, 0, 1]):
        raise at.error("not an intrinsic matrix", expected)
    if matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        raise at.error("a focal length is not positive", expected)
    return matrix


def _rotation(at: Location, value: object) -> Floats:
    matrix = isinstance(value, list) and len(value) == 3 and all(isinstance(row, list) for row in value)
    if matrix and value != [value[0]] * 3:  # type: ignore[index]
        rotation = _numbers(at, value, 2)
        if rotation.shape != (3, 3) or not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4):
            raise at.error("not a rotation matrix", "orthonormal rows")
        if np.linalg.det(rotation) < 0:
            raise at.error("a reflection", "a right-handed rotation")
        return rotation
    if matrix and not np.any(_numbers(at, value, 1)):
        expected = "a 3 x 3 matrix of orthonormal rows, or one rotation vector"
        raise at.error("zeros are no rotation matrix", expected)
    vector = _numbers(at, value, 1)
    if vector.shape != (3,) or np.linalg.norm(vector) > 100.0:
        raise at.error("not a rotation", "a rotation vector or a 3 x 3 matrix")
    return np.asarray(Rotation.from_rotvec(vector).as_matrix())
