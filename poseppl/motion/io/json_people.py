"""Common parts of several detectors' JSON files: lists of numbers, people of frames, frame numbers in file names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location, brief
from poseppl.files.bounded_reading import read_json as read_json
from poseppl.motion.io.detections import MAX_POINTS, DetectedPeople, detected_people
from poseppl.motion.io.text_parsing import some


def numbers(value: object, width: int, at: Location) -> Floats:
    """A table (K, width) of a flat list of numbers, or of a list of lists of ``width`` numbers at least.

    None and NaN are numbers that are not known.

    Raises:
        InputError: It is neither.
    """
    rows = value if isinstance(value, list) else None
    if rows is None or len(rows) > 4 * MAX_POINTS:
        raise at.error("not a list of numbers", f"{width} numbers a point")
    if rows and all(isinstance(row, list) for row in rows):
        if any(len(row) < width for row in rows):
            raise at.error("a point of too few numbers", f"{width} numbers a point")
        flat = [entry for row in rows for entry in row[:width]]
    else:
        flat = rows
    if len(flat) % width:
        raise at.error(f"{len(flat)} numbers", f"{width} numbers a point")
    return np.array([number(entry, at) for entry in flat]).reshape(-1, width)


def number(value: object, at: Location) -> float:
    """A number; NaN for None.

    Raises:
        InputError: It is none.
    """
    if value is None:
        return float("nan")
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise at.error(f"{brief(value)} is not a number", "x, y, confidence, ...")
    try:
        return float(value)
    except OverflowError as error:
        raise at.error("a number is too large", "at most 1e9") from error


def frame_number(value: object, at: Location) -> int:
    """A frame's number: a whole number, or the last one in a file's name.

    Raises:
        InputError: There is none.
    """
    if isinstance(value, str) and len(value) <= 1000:
        found = re.findall("[0-9]+", Path(value).stem if not value.isdigit() else value)
        if found and len(found[-1]) <= 12:
            return int(found[-1])
    if isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 10**12:
        return value
    raise at.error(f"{brief(value)} has no frame number", "a whole number, or a file's name with one, such as img_0012.jpg")


class NumberedFiles(NamedTuple):
    """Files of a folder, one a frame.

    Attributes:
        files: Files by the number of their frame.
        empty: Numbers of the frames whose files hold nothing, in order.
    """

    files: dict[int, Path]
    empty: list[int]


def numbered_files(folder: FilePath, expected: str, suffix: str = ".json") -> NumberedFiles:
    """The files of a folder by the last number in their names; hidden files are left out.

    Args:
        folder: The folder.
        expected: Description of an expected value, for messages.
        suffix: Suffix of the files.

    Raises:
        InputError: There is no such folder, none in it that holds anything, one without a number, or two of the same.
    """
    at = Location(folder)
    if not Path(folder).is_dir():
        raise at.error("no such folder", expected)
    found: dict[int, Path] = {}
    empty = []
    for file in sorted(Path(folder).glob(f"[!.]*{suffix}")):
        frame = frame_number(file.name, Location(file))
        if frame in found:
            raise Location(file).error(f"frame {frame} is also {found[frame].name}", "one file a frame")
        found[frame] = file
        if file.stat().st_size == 0:
            empty.append(frame)
    files = {frame: file for frame, file in found.items() if frame not in set(empty)}
    if not files:
        problem = f"no {suffix} file in the folder" if not empty else f"all {len(empty)} {suffix} files are empty"
        raise at.error(problem, expected)
    return NumberedFiles(files, sorted(empty))


def same_points(
    people: dict[int, list[Floats]], at: Location, times: dict[int, float] | None = None, empty: Sequence[int] = ()
) -> DetectedPeople:
    """Lay out people, of whom all have the same number of points, under the numbers of the points.

    Args:
        people: By frame number, the people, each (K, 3): x, y, confidence.
        at: The file, for messages.
        times: Seconds by frame number.
        empty: Frames whose files hold nothing; they are noted.

    Raises:
        InputError: There is nobody, or they have not.
    """
    counts = sorted({len(person) for found in people.values() for person in found if len(person)})
    if not counts:
        raise at.error(f"nobody was found in any of {len(people)} frames", "at least one person in one frame")
    if len(counts) > 1:
        raise at.error(f"people with {counts} points", "one number of points in all frames")
    seen = {frame: [person for person in found if len(person)] for frame, found in people.items()}
    found = detected_people(seen, [str(point) for point in range(counts[0])], at, times=times)
    if not empty:
        return found
    note = f"{len(empty)} of {len(people)} files are empty, and nobody is seen in their frames: {some(map(str, empty))}"
    return found._replace(notes=(note,))
