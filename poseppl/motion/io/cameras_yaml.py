"""Calibrations in OpenCV's YAML: a file a camera, or EasyMocap's pair ``intri.yml`` and ``extri.yml``.

A camera's own file has ``camera_matrix`` (or ``K``), ``distortion_coefficients`` (``D``), ``image_width``, ``image_height``,
``R`` or ``rvec``, and ``T`` or ``tvec``; the camera goes by the file's name. EasyMocap has ``names``, ``K_1``, ``dist_1`` and
perhaps ``H_1`` and ``W_1`` in the first file, and ``R_1`` (a rotation vector) or ``Rot_1`` (a matrix) and ``T_1`` in the
second. Without a size, the picture is taken for as wide and high as twice the principal point. Lengths have no unit.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from poseppl.errors import FilePath, Location, brief, cut
from poseppl.files.bounded_reading import read_text
from poseppl.files.csv_fields import decimal_number
from poseppl.motion.io.camera_fields import (
    MAX_CAMERAS,
    CameraRecord,
    Field,
    camera_of_fields,
    intrinsics,
)
from poseppl.motion.io.text_parsing import some

_MATRIX_NAMES = ("camera_matrix", "cameraMatrix", "K", "M", "intrinsic_matrix", "mtx")
_DISTORTION = ("distortion_coefficients", "dist_coeffs", "distCoeffs", "D", "dist")
_ROTATION = ("R", "rotation", "rotation_matrix", "rvec")
_TRANSLATION = ("T", "t", "translation", "tvec")
_WIDTH, _HEIGHT = ("image_width", "imageWidth", "width"), ("image_height", "imageHeight", "height")
YAMLS = (".yml", ".yaml")


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
    matrix = _first(fields, _MATRIX_NAMES, at)
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


MAX_LINES = 100_000
MAX_NUMBERS = 100_000
_DEEPEST = 20
_PLAIN = r"[\w.\-](?:[\w.\- ]{0,198}[\w.\-])?"
_KEY = re.compile(rf"""(?:"([^"\\]{{1,200}})"|'([^'\\]{{1,200}})'|({_PLAIN}))\s*:(?:\s+(.*)|)$""", re.ASCII)
_MATRIX_TAG = "!!opencv-matrix"
_Line = tuple[int, int, str]
"""Number of the line, its indent, its text."""


def read_opencv_yaml(path: FilePath) -> dict[str, Any]:
    """Read a YAML file of OpenCV, of at most 4 MiB.

        names: [ "1", "2" ]
        K_1: !!opencv-matrix
           rows: 3
           cols: 3
           dt: d
           data: [ 1680., 0., 532., 0., 1681., 948., 0., 0., 1. ]

    YAML at large has tags that make objects, and names for parts that repeat without end; none of these is known here. A matrix
    becomes a list of rows.

    Raises:
        InputError: The file is none, or holds anything but maps, lists, numbers, texts and matrices; the message tells the
        line.
    """
    at = Location(path)
    lines = _lines(read_text(path, max_bytes=2**22), at)
    if not lines:
        raise at.error("the file is empty", "the YAML that OpenCV writes")
    value, rest = _block(lines, 0, lines[0][1], at, 0)
    if rest < len(lines):
        raise at.in_line(lines[rest][0]).error("the indent fits nothing before it", "the YAML that OpenCV writes")
    if not isinstance(value, dict):
        raise at.error("no map of names to values", "the YAML that OpenCV writes")
    return value


def _lines(text: str, at: Location) -> list[_Line]:
    """Lines that say something; lists that go over several lines are joined."""
    found: list[tuple[int, int, list[str]]] = []
    open_brackets = 0
    for number, line in enumerate(text.split("\n"), start=1):
        stripped = line.strip()
        if not stripped or stripped.startswith(("#", "%", "---", "...")):
            continue
        if number > MAX_LINES:
            raise at.error(f"more than {MAX_LINES} lines", "a calibration")
        if open_brackets > 0:
            found[-1][2].append(stripped)
        else:
            found.append((number, len(line) - len(line.lstrip(" ")), [stripped]))
        outside = re.sub(r'"[^"]*"', "", stripped)
        open_brackets += outside.count("[") - outside.count("]")
    return [(number, indent, " ".join(parts)) for number, indent, parts in found]


def _block(lines: list[_Line], start: int, indent: int, at: Location, depth: int) -> tuple[Any, int]:
    """The map or list that begins in a line, and the line after it."""
    if depth > _DEEPEST:
        raise at.in_line(lines[start][0]).error("too many levels", f"at most {_DEEPEST}")
    items: list[Any] = []
    table: dict[str, Any] = {}
    index = start
    while index < len(lines) and lines[index][1] == indent:
        number, _, text = lines[index]
        here = at.in_line(number)
        if text.startswith("- ") or text == "-":
            items.append(_scalar(text[1:].strip(), here))
            index += 1
            continue
        key, value = _entry(text, here)
        if key in table:
            raise here.error(f"{brief(key)} comes twice", "each name once")
        index += 1
        deeper = index < len(lines) and (lines[index][1] > indent or (value == "" and lines[index][2].startswith("- ")))
        if value in ("", _MATRIX_TAG) and deeper and lines[index][1] >= indent:
            inner, index = _block(lines, index, lines[index][1], at, depth + 1)
            table[key] = _matrix(inner, here) if value == _MATRIX_TAG else inner
        else:
            table[key] = _scalar(value, here)
    if items and table:
        raise at.in_line(lines[start][0]).error("a list and a map in one", "the YAML that OpenCV writes")
    return (items if items else table), index


def _entry(text: str, at: Location) -> tuple[str, str]:
    found = _KEY.match(text)
    if not found:
        raise at.error(f"{brief(text)} is no name and value", "the YAML that OpenCV writes")
    return (found[1] or found[2] or found[3]).strip(), (found[4] or "").strip()


def _scalar(text: str, at: Location) -> Any:
    if text.startswith(("!", "&", "*", "{")):
        raise at.error(brief(text), "numbers, texts, lists and matrices alone")
    if text.startswith("["):
        if not text.endswith("]") or "[" in text[1:]:
            raise at.error("a list that does not end, or contains lists", "[ 1., 2., 3. ]; the file may have been cut off")
        parts = [part.strip() for part in text[1:-1].split(",")]
        parts = parts[:-1] if parts and parts[-1] == "" else parts
        if len(parts) > MAX_NUMBERS:
            raise at.error(f"{len(parts)} numbers", f"at most {MAX_NUMBERS}")
        return [_scalar(part, at) for part in parts]
    if len(text) >= 2 and text[0] == text[-1] and text[0] in "\"'":
        return text[1:-1]
    number = decimal_number(text)
    return text if number is None else number if re.search("[.eE]", text) else int(text)


def _matrix(fields: Any, at: Location) -> list[Any]:
    """Rows of a matrix."""
    if not isinstance(fields, dict) or not {"rows", "cols", "data"} <= set(fields):
        raise at.error("a matrix without rows, cols or data", "rows, cols, dt, data")
    rows, columns, data = fields["rows"], fields["cols"], fields["data"]
    if not (type(rows) is int and type(columns) is int and isinstance(data, list)) or rows * columns != len(data):
        raise at.error(f"{cut(rows, 9)} x {cut(columns, 9)} of other data", "as many numbers as rows x cols")
    if not all(isinstance(value, int | float) for value in data):
        raise at.error(f"data {some(map(str, data), 3)}", "numbers")
    return [data[row * columns : (row + 1) * columns] for row in range(rows)]
