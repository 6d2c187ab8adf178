"""2-D observations of named markers as a CSV file.

The columns are ``frame, marker, x, y`` and, where wanted, ``camera`` and ``confidence``, in any order; x and y in pixels or on
the image plane, as the camera has them. A marker that was not seen in a frame has no row; the frames run without a gap from the
smallest to the largest number in the file.

    frame,marker,x,y
    0,knee_r,512.5,633.25
    0,knee_l,478.0,630.5
"""

from __future__ import annotations

import csv
import difflib
import io
import re
from collections.abc import Iterator, Sequence
from os import PathLike
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseppl.errors import InputError
from poseppl.io.files import atomic_path, read_text
from poseppl.io.number import parse_number

REQUIRED = ("frame", "marker", "x", "y")
OPTIONAL = ("camera", "confidence")
MAX_VALUES = 20_000_000
MAX_GAP = 10_000


class Observations(NamedTuple):
    """2-D observations of K markers in C cameras over T frames.

    Attributes:
        points: (T, C, K, 2) image coordinates; NaN where a marker was not seen.
        confidence: (T, C, K) in [0, 1], NaN where a marker was not seen; None where the file has no such column.
        frames: (T,) consecutive frame numbers.
        markers: K names.
        cameras: C names.
    """

    points: NDArray[np.float64]
    confidence: NDArray[np.float64] | None
    frames: NDArray[np.int64]
    markers: tuple[str, ...]
    cameras: tuple[str, ...]


class _Row(NamedTuple):
    line: int
    frame: int
    camera: int
    marker: int
    x: float
    y: float
    confidence: float


def read_observations(
    path: str | PathLike[str], marker_names: Sequence[str], camera_names: Sequence[str] = ("camera",)
) -> Observations:
    """Read 2-D observations.

    Args:
        path: The CSV file.
        marker_names: The K markers of the body, in its order.
        camera_names: The C cameras. A file without the column ``camera`` goes with one camera, whatever its name.

    Returns:
        The observations.

    Raises:
        InputError: The file is empty, lacks a column, names an unknown marker or camera, repeats an observation, or holds
            something that is not a finite number; the message gives the line.
    """
    lines = _lines(path, read_text(path))
    _, header = next(lines, (1, []))
    columns = _columns(path, header)
    if "camera" not in columns and len(camera_names) != 1:
        raise InputError("no column camera", file=path, line=1, field="camera", expected="one of " + ", ".join(camera_names))
    rows = [_row(path, line, values, columns, marker_names, camera_names) for line, values in lines]
    if not rows:
        raise InputError("the file holds no observation", file=path, expected="at least one row after the header")
    first, total = _frame_range(path, rows, len(camera_names) * len(marker_names))
    points = np.full((total, len(camera_names), len(marker_names), 2), np.nan)
    confidence = np.full(points.shape[:3], np.nan)
    seen: dict[tuple[int, int, int], int] = {}
    for row in rows:
        place = (row.frame - first, row.camera, row.marker)
        if place in seen:
            problem = f"frame {row.frame} observes {marker_names[row.marker]!r} twice (before in line {seen[place]})"
            raise InputError(problem, file=path, line=row.line)
        seen[place] = row.line
        points[place] = (row.x, row.y)
        confidence[place] = row.confidence
    frames = np.arange(first, first + total, dtype=np.int64)
    has_confidence = "confidence" in columns
    return Observations(points, confidence if has_confidence else None, frames, tuple(marker_names), tuple(camera_names))


def write_observations(path: str | PathLike[str], observations: Observations) -> None:
    """Write 2-D observations, atomically; reading gives the same values back.

    Args:
        path: The CSV file.
        observations: The observations. NaN coordinates are left out; leading and trailing frames without any are lost.

    Raises:
        InputError: The file cannot be written.
        PosepplError: The disk is full.
    """
    many, graded = len(observations.cameras) > 1, observations.confidence is not None
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(("frame", *(["camera"] if many else []), "marker", "x", "y", *(["confidence"] if graded else [])))
        for t, c, k in np.argwhere(np.isfinite(observations.points).all(axis=-1)):
            x, y = observations.points[t, c, k]
            row: list[object] = [int(observations.frames[t])]
            row += [observations.cameras[c]] if many else []
            row += [observations.markers[k], repr(float(x)), repr(float(y))]
            row += [repr(float(observations.confidence[t, c, k]))] if observations.confidence is not None else []
            writer.writerow(row)


def _lines(path: str | PathLike[str], text: str) -> Iterator[tuple[int, list[str]]]:
    reader = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True, strict=True)
    while True:
        try:
            row = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise InputError(f"malformed CSV: {error}", file=path, line=reader.line_num) from error
        values = [value.strip() for value in row]
        if any(values):
            yield reader.line_num, values


def _columns(path: str | PathLike[str], header: list[str]) -> dict[str, int]:
    names = [name.lower() for name in header]
    for name in REQUIRED:
        if name not in names:
            found = ", ".join(names)[:80] or "nothing"
            raise InputError(f"no column {name!r}", file=path, line=1, expected=f"{','.join(REQUIRED)}; found {found}")
    for name in names:
        if name not in REQUIRED + OPTIONAL or names.count(name) > 1:
            problem = "column is unknown" if name not in REQUIRED + OPTIONAL else "column is repeated"
            raise InputError(problem, file=path, line=1, field=name[:40], expected=",".join(REQUIRED + OPTIONAL))
    return {name: index for index, name in enumerate(names)}


def _row(
    path: str | PathLike[str],
    line: int,
    values: list[str],
    columns: dict[str, int],
    markers: Sequence[str],
    cameras: Sequence[str],
) -> _Row:
    if len(values) != len(columns):
        raise InputError(f"{len(values)} values", file=path, line=line, expected=f"{len(columns)}, one a column")
    frame = values[columns["frame"]]
    if not re.fullmatch("[0-9]{1,9}", frame):
        raise InputError(f"{frame[:40]!r} is no frame number", file=path, line=line, field="frame", expected="0, 1, 2, ...")
    marker = _known(path, line, "marker", values[columns["marker"]], markers)
    camera = _known(path, line, "camera", values[columns["camera"]], cameras) if "camera" in columns else 0
    x, y = (parse_number(values[columns[name]], file=path, line=line, field=name) for name in ("x", "y"))
    confidence = float("nan")
    if "confidence" in columns:
        confidence = parse_number(values[columns["confidence"]], file=path, line=line, field="confidence")
        if not 0.0 <= confidence <= 1.0:
            raise InputError(f"{confidence:g}", file=path, line=line, field="confidence", expected="0 to 1")
    return _Row(line, int(frame), camera, marker, x, y, confidence)


def _known(path: str | PathLike[str], line: int, field: str, name: str, names: Sequence[str]) -> int:
    if name in names:
        return list(names).index(name)
    close = difflib.get_close_matches(name[:60], names, n=1)
    hint = f"; did you mean {close[0]!r}?" if close else ""
    raise InputError(f"unknown {field} {name[:60]!r}", file=path, line=line, expected=f"one of {', '.join(names)}{hint}")


def _frame_range(path: str | PathLike[str], rows: list[_Row], values: int) -> tuple[int, int]:
    rows = sorted(rows, key=lambda row: row.frame)
    for before, row in zip(rows, rows[1:], strict=False):
        if row.frame - before.frame > MAX_GAP:
            problem = f"{row.frame - before.frame - 1} frames without any row before frame {row.frame}"
            raise InputError(problem, file=path, line=row.line, field="frame", expected=f"a gap of at most {MAX_GAP}")
    first, total = rows[0].frame, rows[-1].frame - rows[0].frame + 1
    if total * values > MAX_VALUES:
        raise InputError(f"{total} frames of {values} points", file=path, expected=f"at most {MAX_VALUES} points in a file")
    return first, total
