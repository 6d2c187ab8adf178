"""Joint angles over time as OpenSim's motion files (.mot): a header that ends in ``endheader``, then a row a frame.

    Coordinates
    version=1
    nRows=131
    nColumns=3
    inDegrees=yes

    Units are S.I. units (second, meters, Newtons, ...)
    endheader
    time  knee_angle_r  pelvis_tx
    0.00  12.5          0.31

Columns are separated by white space or by commas. Rotations are in degrees where the header says so, else in radians; what else
the header holds is text.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location, brief
from poseppl.files.atomic_writing import write_atomically
from poseppl.files.bounded_reading import read_text
from poseppl.motion.io.text_parsing import LONGEST, check_distinct, number_rows
from poseppl.motion.io.trc import column_name

MAX_COLUMNS = 10_000
MAX_VALUES = 40_000_000


class MotionFile(NamedTuple):
    """Content of a motion file.

    Attributes:
        times: (T,) seconds.
        columns: (T,) each, by name; metres and, as `in_degrees` says, degrees or radians.
        in_degrees: The unit of rotations.
    """

    times: Floats
    columns: Mapping[str, Floats]
    in_degrees: bool


def write_mot(path: FilePath, times: Floats, columns: Mapping[str, Floats], notes: Sequence[str] = ()) -> None:
    """Write coordinates, rotations of which are in degrees.

    Args:
        path: The .mot file, overwritten if it exists.
        times: (T,) seconds, ascending.
        columns: (T,) each, degrees or metres, by the names of the coordinates.
        notes: Lines for the header, such as what each column means.

    Raises:
        InputError: A value is not finite, a name cannot stand in the file, or the file cannot be written.
        PosepplError: The disk is full.
    """
    for name, values in columns.items():
        if not np.isfinite(values).all():
            frame = int(np.flatnonzero(~np.isfinite(values))[0])
            raise Location(path).error(f"{name} is not finite at {times[frame]:g} s", "numbers in every frame")
    header = [
        "Coordinates",
        "version=1",
        f"nRows={len(times)}",
        f"nColumns={1 + len(columns)}",
        "inDegrees=yes",
        "",
        "Units are S.I. units (second, meters, Newtons, ...)",
        "Angles are in degrees.",
        *(" ".join(note.split()).replace("=", "is") for note in notes),  # OpenSim takes what has a = for a setting
        "endheader",
        "\t".join(["time", *(column_name(name, path) for name in columns)]),
    ]
    rows = np.column_stack([times, *columns.values()]).tolist()
    body = ["\t".join([f"{time:.9g}", *(f"{value:.8f}" for value in row)]) for time, *row in rows]
    write_atomically(path, "\n".join([*header, *body]) + "\n")


def read_mot(path: FilePath) -> MotionFile:
    """Read a motion file, OpenSim's or ours.

    Raises:
        InputError: The file has no header or no rows, or something in it is no finite number.
    """
    at, lines = Location(path), read_text(path).split("\n")
    ends = [number for number, line in enumerate(lines) if line.strip().strip(",").lower() == "endheader"]
    if not ends or len(lines) < ends[0] + 3:
        raise at.error("no line endheader with columns after it", "a motion file of OpenSim")
    known = dict(line.strip().strip(",").partition("=")[::2] for line in lines[: ends[0]])
    names = _fields(lines[ends[0] + 1])
    here = at.in_line(ends[0] + 2)
    if names[:1] != ["time"] or not 1 < len(names) <= MAX_COLUMNS or max(map(len, names)) > LONGEST:
        raise here.error(f"{len(names)} columns, the first {brief(names[:1])}", f"time, and 1 to {MAX_COLUMNS} others")
    check_distinct(names, "columns", here)
    rows = ((at.in_line(number), _fields(line)) for number, line in enumerate(lines[ends[0] + 2 :], start=ends[0] + 3))
    table = number_rows((line for line in rows if line[1]), names, MAX_VALUES)
    if not len(table):
        raise at.error("no frame", "rows of numbers after the header")
    times, *values = table.T
    return MotionFile(times, dict(zip(names[1:], values, strict=True)), known.get("inDegrees", "no").strip().lower() == "yes")


def _fields(line: str) -> list[str]:
    return [field.strip() for field in line.split(",")] if "," in line else line.split()
