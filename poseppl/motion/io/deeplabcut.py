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
from typing import Any, NamedTuple

import h5py
import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location, brief
from poseppl.files.csv_fields import Line, rows_of_csv
from poseppl.files.hdf5_reading import array, attribute, child, open_hdf5, texts
from poseppl.files.plain_pickle import plain_of_pickle
from poseppl.motion.io.detections import MAX_FRAMES, DetectedPeople, check_names, check_room, detected_people
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


_EXPECTED = "the table of points that DeepLabCut writes, such as videoDLC_resnet50.h5"
_LEVELS = {3: ("scorer", "bodyparts", "coords"), 4: ("scorer", "individuals", "bodyparts", "coords")}


class _Table(NamedTuple):
    """Names of columns, one tuple a column; numbers (T, columns); the word of each row's frame."""

    columns: list[tuple[str, ...]]
    values: Floats
    rows: list[str]


def read_deeplabcut_h5(path: FilePath) -> DetectedPeople:
    """Read an HDF5 file of DeepLabCut or Lightning Pose, of one animal or several.

    Args:
        path: The file.

    Returns:
        The points under the file's own names, with ``individuals`` where it has several.

    Raises:
        InputError: The file is none of these, is damaged, or holds no point.
    """
    at = Location(path)
    with open_hdf5(path, _EXPECTED) as file:
        groups = [name for name in file if is_pandas(file, name)]
        if len(groups) != 1:
            raise at.error(f"{len(groups)} tables of pandas in the file", f"one, as in {_EXPECTED}")
        group = child(file, groups[0], at)
        table = _rows(group, at) if "table" in group else _blocks(group, at)
    if table.values.shape != (len(table.rows), len(table.columns)) or len(table.columns) > MAX_COLUMNS:
        raise at.error(f"{table.values.shape} values for {len(table.columns)} columns", _EXPECTED)
    depth = {len(column) for column in table.columns}
    if len(depth) != 1 or not depth <= set(_LEVELS):
        raise at.error("columns with other names than scorer, bodyparts, coords", _EXPECTED)
    header = dict(zip(_LEVELS[depth.pop()], map(list, zip(*table.columns, strict=True)), strict=True))
    columns = point_columns(header, at)
    values = table.values[:, columns.columns]
    return people_of_rows(columns, ((at, word, row.tolist()) for word, row in zip(table.rows, values, strict=True)), at)


def is_pandas(file: h5py.File, name: str) -> bool:
    """Whether a member of a file is a table of pandas."""
    if not isinstance(file.get(name, getlink=True), h5py.HardLink) or file.get(name, getclass=True) is not h5py.Group:
        return False
    return "pandas_type" in file[name].attrs


def _rows(group: Any, at: Location) -> _Table:
    """The form "table": a compound array of an index and a block of numbers of one kind."""
    table = child(group, "table", at)
    values = array(group, "table", at)
    if values.dtype.names is None or not {"index", "values_block_0"} <= set(values.dtype.names):
        raise at.error("a table without values_block_0", _EXPECTED)
    if any(name.startswith("values_block_") and name != "values_block_0" for name in values.dtype.names):
        raise at.error("columns of several kinds", _EXPECTED)
    pickled = attribute(table, "values_block_0_kind", at)
    if not isinstance(pickled, bytes):
        raise at.in_field("values_block_0_kind").error("no names of columns", _EXPECTED)
    names = plain_of_pickle(bytes(pickled), at.in_field("values_block_0_kind"))
    if not isinstance(names, list) or not all(isinstance(name, tuple) and all(type(n) is str for n in name) for name in names):
        raise at.in_field("values_block_0_kind").error("no names of columns", _EXPECTED)
    return _Table(names, _numbers(values["values_block_0"], at), _words(values["index"], at))


def _blocks(group: Any, at: Location) -> _Table:
    """The form "fixed": one block of numbers, and its names by levels."""
    if attribute(group, "nblocks", at) != 1:
        raise at.error("columns of several kinds", _EXPECTED)
    levels = attribute(group, "block0_items_nlevels", at)
    if levels not in (3, 4):
        raise at.error("columns with other names than scorer, bodyparts, coords", _EXPECTED)
    named = [_level(group, f"block0_items_level{n}", f"block0_items_label{n}", at) for n in range(int(levels))]
    if len({len(names) for names in named}) != 1:
        raise at.error("names of columns that are none", _EXPECTED)
    return _Table(list(zip(*named, strict=True)), _numbers(array(group, "block0_values", at), at), _index(group, at))


def _index(group: Any, at: Location) -> list[str]:
    if "axis1" in group:
        return _words(array(group, "axis1", at), at)
    last = int(attribute(group, "axis1_nlevels", at) or 1) - 1
    return _level(group, f"axis1_level{last}", f"axis1_label{last}", at)


def _level(group: Any, labels: str, codes: str, at: Location) -> list[str]:
    """One level of names: the labels that codes stand for."""
    words, numbers = texts(_listed(array(group, labels, at), at)), np.ravel(_listed(array(group, codes, at), at))
    if numbers.dtype.kind not in "iu" or not all(0 <= number < len(words) for number in numbers):
        raise at.in_field(codes).error("codes of no label", _EXPECTED)
    return [words[number] for number in numbers]


def _words(index: Any, at: Location) -> list[str]:
    values = _listed(index, at)
    if values.ndim != 1 or values.dtype.kind not in "iuS":
        raise at.error("an index that is none", _EXPECTED)
    return texts(values) if values.dtype.kind == "S" else list(map(str, values.tolist()))


def _listed(values: Any, at: Location) -> Any:
    if values.size > MAX_FRAMES:
        raise at.error(f"{values.size} names or numbers of frames", f"at most {MAX_FRAMES}")
    return np.asarray(values)


def _numbers(values: Any, at: Location) -> Floats:
    if values.ndim != 2 or values.dtype.kind != "f":
        raise at.error(f"values of type {values.dtype} and shape {values.shape}", _EXPECTED)
    return np.asarray(values, np.float64)
