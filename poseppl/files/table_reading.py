"""Tables of numbers, one row a frame: CSV, Parquet, or the variables of a NetCDF file."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseppl.errors import FilePath, InputError, Location, brief
from poseppl.files.bounded_reading import check_file
from poseppl.files.csv_fields import decimal_number, rows_of_csv
from poseppl.files.netcdf import read_netcdf

_EXPECTED = "a table of numbers: NAME.csv, NAME.parquet or NAME.nc"
_MISSING = ("", "na", "nan", "null", "none")
"""Words for a missing number, in upper or lower case."""
_MAX_BYTES, _MAX_NUMBERS = 2**30, 40_000_000
"""Bounds on a Parquet file, packed and unpacked."""
_Read = Callable[[], NDArray[Any]]
"""Reads a column, or raises what is wrong with it."""


class WordAmongNumbers(InputError):
    """A column of numbers with a word in it, such as a number that is misspelt."""


class NumberTable(NamedTuple):
    """The columns of a table.

    Attributes:
        columns: Columns (T,), or variables (T, ...), by name; NaN where a number is missing.
        unread: The problem of each column without numbers, such as dates, or with words among numbers.
    """

    columns: dict[str, NDArray[Any]]
    unread: dict[str, InputError]

    @property
    def misspelt(self) -> list[WordAmongNumbers]:
        """The problems of columns that have a word among numbers."""
        return [error for error in self.unread.values() if isinstance(error, WordAmongNumbers)]


def read_table(path: FilePath) -> NumberTable:
    """Read the columns of a table.

    Args:
        path: A .csv file with a head, a .parquet file, or a .nc file of variables (T, ...). Blank lines between the rows of a
            CSV file are rows without numbers; those at its end are none.

    Raises:
        InputError: The file is of another kind or cannot be read; says where.
    """
    kind = Path(path).suffix.lower()
    if kind == ".csv":
        readers = _columns_of_csv(path)
    elif kind in (".parquet", ".pq"):
        readers = _columns_of_parquet(path)
    elif kind == ".nc":
        variables = read_netcdf(path, expected=_EXPECTED).dataset.variables
        readers = {str(name): partial(_numbers, Location(path, field=str(name)), of.values) for name, of in variables.items()}
    else:
        raise Location(path).error(f"a file of the kind {brief(kind or 'of no kind')}", _EXPECTED)
    table = NumberTable({}, {})
    for name, read in readers.items():
        try:
            table.columns[name] = read()
        except InputError as error:
            table.unread[name] = error
    return table


def _columns_of_csv(path: FilePath) -> dict[str, _Read]:
    (at, names), *rows = list(rows_of_csv(path, empty=True)) or [(Location(path), [])]
    if len(set(names)) < len(names) or "" in names or not names:
        raise at.error(f"its head is {brief(names)}", "a name for each column, all different")
    if len(names) == 1 and (";" in names[0] or "\t" in names[0]):
        raise at.error(f"its head is one column, {brief(names[0])}", "commas between columns, and points in numbers")
    if not rows:
        raise Location(path).error("no row below its head", "a row for each frame")
    places, words = zip(*rows, strict=True)
    return {name: partial(_column, name, places, column) for name, column in zip(names, zip(*words, strict=True), strict=True)}


def _column(name: str, places: Sequence[Location], words: Sequence[str]) -> NDArray[Any]:
    numbers = [_number(word) for word in words]
    wrong = [index for index, number in enumerate(numbers) if number is None]
    if wrong:
        at, some = places[wrong[0]], any(not math.isnan(number) for number in numbers if number is not None)
        error_class = WordAmongNumbers if some else InputError
        more = f", as in {len(wrong) - 1} more rows" if len(wrong) > 1 else ""
        expected = "a number, or nothing where none is"
        raise error_class(f"{brief(words[wrong[0]])}{more}", file=at.file, line=at.line, field=name, expected=expected)
    return np.array(numbers, float)


def _number(word: str) -> float | None:
    """The number that a word stands for, NaN where it is missing; None of another word."""
    number = math.nan if word.lower() in _MISSING else decimal_number(word)
    return None if number is None or math.isinf(number) else number


def _columns_of_parquet(path: FilePath) -> dict[str, _Read]:
    """The columns of numbers alone are read: a few bytes may stand for texts without end, in each row one of a dictionary."""
    source, at = check_file(path, max_bytes=_MAX_BYTES), Location(path)
    try:
        arrow, parquet = (import_module(name) for name in ("pyarrow", "pyarrow.parquet"))
    except ImportError:
        raise at.error("Parquet needs pyarrow", "pip install 'poseppl[tables]', or a CSV file") from None
    of_numbers = (arrow.types.is_integer, arrow.types.is_floating, arrow.types.is_boolean)
    try:
        kinds = {field.name: field.type for field in parquet.read_schema(source)}
        numeric = [name for name, kind in kinds.items() if any(is_kind(kind) for is_kind in of_numbers)]
        count = parquet.read_metadata(source).num_rows * len(numeric)
        table = parquet.read_table(source, columns=numeric) if count <= _MAX_NUMBERS else None
    except Exception as error:  # pyarrow's own errors, of which there are many
        raise at.error(f"no Parquet: {error}", _EXPECTED) from error
    if table is None:
        raise at.error(f"declares {count} numbers", f"at most {_MAX_NUMBERS}")

    def read(name: str) -> NDArray[Any]:
        if name not in numeric:
            raise at.in_field(name).error(f"{kinds[name]}", "numbers, one row a frame")
        return _numbers(at.in_field(name), table[name].to_pandas().to_numpy())

    return {name: partial(read, name) for name in kinds}


def _numbers(at: Location, values: NDArray[Any]) -> NDArray[Any]:
    if values.dtype.kind not in "fiub" or values.ndim == 0:
        raise at.error(f"{values.dtype} of shape {values.shape}", "numbers, one row a frame")
    return values
