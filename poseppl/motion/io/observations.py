"""Points of named markers or joints as CSV files: 2-D observations, and true places in mm, Z up.

The columns of observations are ``frame, marker, x, y`` and, where wanted, ``camera`` and ``confidence``, in any order; x and y
in pixels or on the image plane, as the camera has them. A marker that was not seen in a frame, or whose place is not known,
has no row; the frames run without a gap from the smallest to the largest number in the file.

    frame,marker,x,y                        frame,marker,x,y,z
    0,knee_r,512.5,633.25                   0,knee_r,512.5,33.25,480.0
    0,knee_l,478.0,630.5                    0,knee_l,478.0,30.5,482.25
"""

from __future__ import annotations

import difflib
from array import array
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats, Integers
from poseppl.errors import FilePath, Location, brief, cut
from poseppl.files.atomic_writing import write_rows
from poseppl.files.csv_fields import rows_of_csv
from poseppl.motion.io.text_parsing import parse_frame, parse_number, some

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

    points: Floats
    confidence: Floats | None
    frames: Integers
    markers: tuple[str, ...]
    cameras: tuple[str, ...]


def read_observations(path: FilePath, marker_names: Sequence[str], camera_names: Sequence[str] = ("camera",)) -> Observations:
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
    at, lines = Location(path), rows_of_csv(path)
    _, header = next(lines, (at, []))
    columns = _columns(at.in_line(1), header)
    if "camera" not in columns and len(camera_names) != 1:
        raise at.in_line(1).in_field("camera").error("no column camera", "one of " + some(camera_names))
    rows = array("d")
    for here, values in lines:
        rows.extend(_row(here, values, columns, marker_names, camera_names))
    if not rows:
        raise at.error("the file has no observation", "at least one row after the header")
    table = np.array(rows).reshape(-1, 7)
    line_numbers, numbers, camera, marker = table[:, :4].astype(np.int64).T
    first, total = _frame_range(at, numbers, line_numbers, len(camera_names) * len(marker_names))
    points = np.full((total, len(camera_names), len(marker_names), 2), np.nan)
    confidence = np.full(points.shape[:3], np.nan)
    place = np.ravel_multi_index((numbers - first, camera, marker), confidence.shape)
    order = np.argsort(place, kind="stable")
    twice = np.flatnonzero(np.diff(place[order]) == 0)
    if twice.size:
        before, after = order[twice[0]], order[twice[0] + 1]
        name = marker_names[marker[after]]
        problem = f"frame {numbers[after]} observes {brief(name)} twice (before in line {line_numbers[before]})"
        raise at.in_line(int(line_numbers[after])).error(problem)
    points.reshape(-1, 2)[place] = table[:, 4:6]
    confidence.reshape(-1)[place] = table[:, 6]
    frames = np.arange(first, first + total, dtype=np.int64)
    has_confidence = "confidence" in columns
    return Observations(points, confidence if has_confidence else None, frames, tuple(marker_names), tuple(camera_names))


def write_observations(path: FilePath, observations: Observations) -> None:
    """Write 2-D observations, atomically; reading gives the same values back.

    Args:
        path: The CSV file.
        observations: The observations. NaN coordinates are left out; leading and trailing frames without any are lost.

    Raises:
        InputError: The file cannot be written.
        PosepplError: The disk is full.
    """
    many, graded = len(observations.cameras) > 1, observations.confidence is not None
    columns = ("frame", "camera", "marker", "x", "y", "confidence")
    kept = [name for name in columns if (name != "camera" or many) and (name != "confidence" or graded)]
    rows: list[list[object]] = [[*kept]]
    for t, c, k in np.argwhere(np.isfinite(observations.points).all(axis=-1)):
        x, y = observations.points[t, c, k].tolist()
        confidence = None if observations.confidence is None else float(observations.confidence[t, c, k])
        row = (int(observations.frames[t]), observations.cameras[c], observations.markers[k], x, y, confidence)
        rows.append([value for name, value in zip(columns, row, strict=True) if name in kept])
    write_rows(path, rows)


def _columns(at: Location, header: list[str]) -> dict[str, int]:
    names = [name.lower() for name in header]
    for name in REQUIRED:
        if name not in names:
            found = cut(", ".join(names), 80) or "nothing"
            raise at.error(f"no column {brief(name)}", f"{','.join(REQUIRED)}; found {found}")
    for name in names:
        if name not in REQUIRED + OPTIONAL or names.count(name) > 1:
            problem = "column is unknown" if name not in REQUIRED + OPTIONAL else "column is repeated"
            raise at.in_field(name).error(problem, ",".join(REQUIRED + OPTIONAL))
    return {name: index for index, name in enumerate(names)}


def _row(
    at: Location,
    values: list[str],
    columns: dict[str, int],
    markers: Sequence[str],
    cameras: Sequence[str],
) -> tuple[float, ...]:
    frame = parse_frame(values[columns["frame"]], at)
    marker = _known(at, "marker", values[columns["marker"]], markers)
    camera = _known(at, "camera", values[columns["camera"]], cameras) if "camera" in columns else 0
    x, y = (parse_number(values[columns[name]], at.in_field(name)) for name in ("x", "y"))
    confidence = float("nan")
    if "confidence" in columns:
        confidence = parse_number(values[columns["confidence"]], at.in_field("confidence"))
        if not 0.0 <= confidence <= 1.0:
            raise at.in_field("confidence").error(f"{confidence:g}", "0 to 1")
    return (at.line or 0, frame, camera, marker, x, y, confidence)


def _known(at: Location, field: str, name: str, names: Sequence[str]) -> int:
    if name in names:
        return list(names).index(name)
    close = difflib.get_close_matches(name[:60], names, n=1)
    hint = f"; did you mean {brief(close[0])}?" if close else ""
    raise at.error(f"unknown {field} {brief(name)}", f"one of {some(names, 20)}{hint}")


def _frame_range(at: Location, numbers: Integers, lines: Integers, values: int) -> tuple[int, int]:
    order = np.argsort(numbers, kind="stable")
    gaps = np.diff(numbers[order])
    if gaps.size and gaps.max() > MAX_GAP:
        after = order[int(gaps.argmax()) + 1]
        problem = f"{gaps.max() - 1} frames without any row before frame {numbers[after]}"
        expected = f"a gap of at most {MAX_GAP}"
        raise at.in_line(int(lines[after])).in_field("frame").error(problem, expected)
    first, total = int(numbers.min()), int(np.ptp(numbers)) + 1
    if total * values > MAX_VALUES:
        raise at.error(f"{total} frames of {values} points", f"at most {MAX_VALUES} points in a file")
    return first, total


COLUMNS = ("frame", "marker", "x", "y", "z")


def write_places(path: FilePath, frames: Integers, names: Sequence[str], places: Floats) -> None:
    """Write places, atomically; reading gives the same values back.

    Args:
        path: The CSV file.
        frames: (T,) frame numbers.
        names: K names.
        places: (T, K, 3) mm; NaN where unknown.

    Raises:
        InputError: The file cannot be written.
        PosepplError: The disk is full.
    """
    seen = np.argwhere(np.isfinite(places).all(-1))
    write_rows(path, [COLUMNS, *([int(frames[t]), names[k], *places[t, k].tolist()] for t, k in seen)])


def read_places(path: FilePath, names: Sequence[str]) -> tuple[Integers, Floats]:
    """Read the places of some markers; others in the file are passed over.

    Args:
        path: The CSV file.
        names: K names.

    Returns:
        The numbers (T,) of the frames in the file, in order, and places (T, K, 3) in mm, NaN where there is no row.

    Raises:
        InputError: The file is empty, has other columns, repeats a place, or holds something that is not a finite number.
    """
    known = {name: index for index, name in enumerate(names)}
    rows: dict[tuple[int, str], tuple[float, ...]] = {}
    lines = rows_of_csv(path)
    at, header = next(lines, (Location(path, 1), []))
    if tuple(header) != COLUMNS:
        raise at.error(f"columns {brief(','.join(header))}", ",".join(COLUMNS))
    for at, row in lines:
        key, place = _place_row(at, row)
        if key in rows:
            raise at.error(f"frame {key[0]} has {brief(key[1])} twice")
        rows[key] = place
    if not rows:
        raise Location(path).error("the file has no position", "at least one row after the header")
    frames = np.array(sorted({frame for frame, _ in rows}), np.int64)
    places = np.full((len(frames), len(names), 3), np.nan)
    for (frame, name), place in rows.items():
        if name in known:
            places[np.searchsorted(frames, frame), known[name]] = place
    return frames, places


def _place_row(at: Location, row: list[str]) -> tuple[tuple[int, str], tuple[float, ...]]:
    place = tuple(parse_number(text, at.in_field(field)) for field, text in zip(COLUMNS[2:], row[2:], strict=True))
    return (parse_frame(row[0], at), row[1]), place
