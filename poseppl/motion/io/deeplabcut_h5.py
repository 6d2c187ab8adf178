"""Points as DeepLabCut writes them into HDF5: the table of :mod:`poseppl.motion.io.deeplabcut`, stored by pandas.

Pandas has two forms. In "table", the rows are a compound array, and the names of the columns a pickled attribute, which is read
as plain texts and nothing else (:mod:`poseppl.files.plain_pickle`). In "fixed", names are arrays. Neither is read by
pandas, whose reader unpickles.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import h5py
import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location
from poseppl.files.hdf5_reading import array, attribute, child, open_hdf5, texts
from poseppl.files.plain_pickle import plain_of_pickle
from poseppl.motion.io.deeplabcut import MAX_COLUMNS, people_of_rows, point_columns
from poseppl.motion.io.detections import MAX_FRAMES, DetectedPeople

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
