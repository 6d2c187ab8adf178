"""Marker trajectories as TRC text (Motion Analysis, OpenSim, OpenCap), read and written: a header, then a row a frame.

    PathFileType  4  (X/Y/Z)  walk.trc
    DataRate  CameraRate  NumFrames  NumMarkers  Units  OrigDataRate  OrigDataStartFrame  OrigNumFrames
    100       100         131        2           mm     100           1                   131
    Frame#  Time  C7          L.ASIS
                  X1  Y1  Z1  X2  Y2  Z2
    1       0.00  1.0 2.0 3.0

Columns are separated by tabs, or by commas. Programs differ in what they write, so only the fields that the numbers need are
taken from the
header: names, rate and unit. Empty fields are markers that were not seen. The axis that points up is found in the data: OpenSim
writes Y up, other programs Z.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from poseppl.arrays import Floats, Integers
from poseppl.errors import FilePath, Location, brief
from poseppl.files.atomic_writing import write_atomically
from poseppl.files.bounded_reading import read_text
from poseppl.motion.io.motion import Motion, y_up, z_up
from poseppl.motion.io.text_parsing import LONGEST, check_distinct, parse_number
from poseppl.motion.io.units_and_axes import mm_per_unit, vertical_axis

MAX_MARKERS = 10_000
MAX_VALUES = 40_000_000
_UNSEEN = ("", "nan")


def read_trc(path: FilePath, *, up: str | None = None) -> Motion:
    """Read the markers of a TRC file.

    Args:
        path: The .trc file.
        up: The axis that points up; by default the one along which the head is above the feet, else "y".

    Returns:
        The motion, Z up, in mm: a cloud of markers without parents; NaN where a marker was not seen. Markers that no frame
        shows are left out.

    Raises:
        InputError: The file is malformed, its unit is unknown, or it holds no marker.
    """
    lines, at = read_text(path).split("\n"), Location(path)
    separator = "," if "," in lines[0] and "\t" not in lines[0] else "\t"
    rows = [[field.strip() for field in line.split(separator)] for line in lines[:4]]
    rate, mm = _header(at.in_line(3), rows)
    names = _names(at.in_line(4), rows[3])
    places = _places(at, lines, separator, len(names)) * mm
    seen = [index for index in range(len(names)) if np.isfinite(places[:, index]).all(-1).any()]
    if not seen:
        raise at.error("no frame shows a marker")
    kept = tuple(names[index] for index in seen)
    vertical = vertical_axis(kept, places[:, seen], given=up, usual="y", kind="TRC files", agreed=True)
    return Motion(kept, z_up(places[:, seen], vertical.axis), (), rate, str(path), (vertical.note(),))


def write_trc(path: FilePath, motion: Motion, times: Floats, frames: Integers) -> None:
    """Write the points of a motion, Y up, in mm, as OpenSim reads them.

    Args:
        path: The .trc file, overwritten if it exists.
        motion: The motion, Z up, in mm, every point known in every frame: OpenSim stops at what is no number.
        times: (T,) seconds.
        frames: (T,) frame numbers.

    Raises:
        InputError: A position is not finite, a name cannot stand in the file, or the file cannot be written.
        PosepplError: The disk is full.
    """
    unknown = np.argwhere(~np.isfinite(motion.positions).all(-1))
    if unknown.size:
        frame, point = unknown[0]
        problem = f"frame {frames[frame]}: {brief(motion.names[point])} has no finite place"
        raise Location(path).error(problem, "every point in every frame; leave the frame or the point out")
    names = [column_name(name, path) for name in motion.names]
    rate, count = f"{motion.rate:.10g}", len(times)
    header = {"DataRate": rate, "CameraRate": rate, "NumFrames": count, "NumMarkers": len(names), "Units": "mm"}
    header |= {"OrigDataRate": rate, "OrigDataStartFrame": frames[0], "OrigNumFrames": count}
    axes = [f"{axis}{number}" for number in range(1, len(names) + 1) for axis in "XYZ"]
    lines: list[list[object]] = [
        ["PathFileType", 4, "(X/Y/Z)", Path(path).name],
        [*header],
        [*header.values()],
        ["Frame#", "Time", *(field for name in names for field in (name, "", ""))],
        ["", "", *axes],
        [],
    ]
    places = y_up(motion.positions).reshape(len(times), -1)
    for frame, time, row in zip(frames, times, places.tolist(), strict=True):
        lines.append([frame, f"{time:.9g}", *(f"{value:.4f}" for value in row)])
    write_atomically(path, "".join("\t".join(map(str, line)) + "\n" for line in lines))


def column_name(name: str, path: FilePath) -> str:
    """The name of a column of text that tabs separate, unchanged.

    Raises:
        InputError: It is empty or holds a space, a tab or the end of a line, which OpenSim takes for the column's end.
    """
    if not name or any(letter.isspace() or not letter.isprintable() for letter in name):
        raise Location(path).error(f"a column cannot be named {brief(name)}", "letters without spaces")
    return name


def _header(at: Location, rows: list[list[str]]) -> tuple[float, float]:
    """Frames a second, and mm in a unit of length."""
    if len(rows) < 4 or rows[3][:1] != ["Frame#"]:
        raise at.in_line(4).error("no line Frame#, Time, ...", "a TRC file, separated by tabs or commas")
    keys, values = ([field for field in row if field] for row in rows[1:3])  # some programs double the tabs of one line
    known = dict(zip(map(str.lower, keys), values, strict=False))
    rate = parse_number(known.get("datarate", ""), at.in_field("DataRate"))
    if not 1e-3 <= rate <= 1e5:
        raise at.in_field("DataRate").error(f"{rate:g} frames a second", "a positive rate")
    return rate, mm_per_unit(known.get("units", "mm").lower(), at.in_field("Units"))


def _names(at: Location, row: list[str]) -> list[str]:
    names = [name for name in row[2:] if name]
    longest = max(map(len, names), default=0)
    if not 0 < len(names) <= MAX_MARKERS or longest > LONGEST:
        raise at.error(f"{len(names)} markers", f"1 to {MAX_MARKERS}, with names")
    check_distinct(names, "markers", at)
    return names


def _places(at: Location, lines: list[str], separator: str, count: int) -> Floats:
    """(T, K, 3) in the file's unit."""
    rows: list[list[float]] = []
    for number, line in enumerate(lines[5:], start=6):
        here = at.in_line(number)
        fields = [field.strip() for field in line.split(separator)]
        if not any(fields):
            continue
        values = fields[2 : 2 + 3 * count]
        if len(fields) < 2 or any(fields[2 + 3 * count :]):
            raise here.error(f"{len(fields)} fields", f"{2 + 3 * count}, or fewer")
        numbers = [
            np.nan if text.lower() in _UNSEEN else parse_number(text, here.in_field(f"column {column}"))
            for column, text in enumerate(values, start=3)
        ]
        rows.append(numbers + [np.nan] * (3 * count - len(numbers)))
        if len(rows) * 3 * count > MAX_VALUES:
            raise here.error("too many values", f"at most {MAX_VALUES}")
    if not rows:
        raise at.error("no frame", "rows of numbers after the header")
    places = np.array(rows).reshape(len(rows), count, 3)
    return np.where(np.isfinite(places).all(-1, keepdims=True), places, np.nan)
