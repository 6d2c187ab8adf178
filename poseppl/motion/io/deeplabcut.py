"""Points as DeepLabCut and Lightning Pose write them: a CSV file with header rows, one row a frame.

    scorer,network,network,network,...
    individuals,first,first,first,...      several animals alone
    bodyparts,knee,knee,knee,...
    coords,x,y,likelihood,...
    0,194.6980,161.2993,0.9946,...

Columns of other coordinates (variances of ensembles) are passed over. Without a likelihood, as in labels by hand, what is
there has a confidence of 1. An empty field and NaN are points that were not found, whatever their likelihood. The first
columns tell the frame: a number, or the number in the name of a picture.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location, brief
from poseppl.files.csv_reading import Line, rows_of_csv
from poseppl.motion.io.detections import DetectedPeople, check_names, check_room, detected_people
from poseppl.motion.io.json_people import frame_number
from poseppl.motion.io.text_parsing import parse_number, some

MAX_COLUMNS = 30_000
_HEADERS = ("scorer", "individuals", "bodyparts", "coords")
_NOT_A_NUMBER = frozenset({"", "nan", "na", "null", "none"})
_COORDINATES = ("x", "y", "likelihood")


class PointColumns(NamedTuple):
    """Which columns hold which coordinates.

    Attributes:
        individuals: P names; () where the file names none.
        names: K names of points.
        columns: Numbers of columns.
        places: For each of these columns, the individual, the point, and 0, 1 or 2 for x, y, likelihood.
        graded: Whether there are likelihoods.
    """

    individuals: tuple[str, ...]
    names: tuple[str, ...]
    columns: tuple[int, ...]
    places: tuple[tuple[int, int, int], ...]
    graded: bool

    def people(self, values: Sequence[float]) -> list[Floats]:
        """The points (K, 3) of each individual, from the values of the columns."""
        table = np.full((max(len(self.individuals), 1), len(self.names), 3), np.nan)
        if not self.graded:
            table[..., 2] = 1.0
        table[tuple(np.array(self.places).T)] = values
        return list(table)


def read_deeplabcut_csv(path: FilePath) -> DetectedPeople:
    """Read a CSV file of DeepLabCut or Lightning Pose, of one animal or several.

    Args:
        path: The file.

    Returns:
        The points under the file's own names, with ``individuals`` where it has several.

    Raises:
        InputError: The file is none of these, is malformed, or holds no point; the message tells the line.
    """
    lines = rows_of_csv(path)
    header: dict[str, list[str]] = {}
    at: Location = Location(path)
    while "coords" not in header:
        at, row = next(lines, (Location(path), [""]))
        level = row[0].lower()
        if level not in _HEADERS or level in header:
            raise at.error(f"{brief(row[0])} where a header row begins", "rows that begin with scorer, bodyparts, coords")
        if len(row) > MAX_COLUMNS:
            raise at.error(f"{len(row)} columns", f"at most {MAX_COLUMNS}")
        header[level] = row
    for level in ("scorer", "bodyparts"):
        if level not in header:
            raise at.error(f"no header row {level}", "rows that begin with scorer, bodyparts, coords")
    index = _index_columns(header["coords"])
    columns = point_columns({level: row[index:] for level, row in header.items()}, at)
    return people_of_rows(columns, (_row(line, index, columns) for line in lines), Location(path))


def people_of_rows(
    columns: PointColumns, rows: Iterable[tuple[Location, str, Sequence[float]]], at: Location
) -> DetectedPeople:
    """Lay out the rows of a table.

    Args:
        columns: Its columns.
        rows: For each row its position, the last word of its index, and the values of the columns.
        at: The file, for messages.

    Raises:
        InputError: An index is no frame, two are of one, or there is no point in any.
    """
    people: dict[int, Sequence[Floats]] = {}
    for here, word, values in rows:
        number = frame_number(word, here)
        if number in people:
            raise here.error(f"frame {number} comes twice", "one row a frame")
        check_room(len(people) + 1, max(len(columns.individuals), 1), len(columns.names), at)
        people[number] = columns.people(values)
    return detected_people(people, columns.names, at, individuals=columns.individuals)


def point_columns(header: Mapping[str, Sequence[str]], at: Location) -> PointColumns:
    """Find the coordinates of points among columns.

    Args:
        header: The words of each column by level: "bodyparts", "coords", and "individuals" where there are several.
        at: Position, for the message.

    Raises:
        InputError: A point has no x or no y, or one twice.
    """
    parts, coords = header["bodyparts"], [word.lower() for word in header["coords"]]
    owners = header.get("individuals", [""] * len(parts))
    kept = [column for column, word in enumerate(coords) if word in _COORDINATES]
    individuals = tuple(dict.fromkeys(owners[column] for column in kept))
    names = tuple(dict.fromkeys(parts[column] for column in kept))
    check_names(names, "bodyparts", at)
    if "individuals" in header:
        check_names(individuals, "individuals", at)
    person = {name: number for number, name in enumerate(individuals)}
    point = {name: number for number, name in enumerate(names)}
    places = tuple((person[owners[c]], point[parts[c]], _COORDINATES.index(coords[c])) for c in kept)
    known = set(places)
    graded = any(place[2] == 2 for place in places)
    for p, k in {place[:2] for place in places}:
        if {(p, k, 0), (p, k, 1)} - known or (graded and (p, k, 2) not in known):
            problem = f"{brief(' '.join([individuals[p], names[k]]).strip())} lacks a coordinate"
            raise at.error(problem, "x, y and likelihood of each point")
    if len(known) < len(places):
        raise at.error(f"a coordinate comes twice among {some(names)}", "x, y and likelihood of each point once")
    return PointColumns(individuals if "individuals" in header else (), names, tuple(kept), places, graded)


def _index_columns(coords: Sequence[str]) -> int:
    """How many columns at the left tell the frame: the first, and those after it that are empty in the header."""
    count = 1
    while count < len(coords) and not coords[count]:
        count += 1
    return count


def _row(line: Line, index: int, columns: PointColumns) -> tuple[Location, str, list[float]]:
    at, row = line
    words = [row[index + column] for column in columns.columns]
    values = [math.nan if word.lower() in _NOT_A_NUMBER else parse_number(word, at) for word in words]
    return at, row[index - 1], values
