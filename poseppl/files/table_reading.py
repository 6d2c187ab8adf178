"""Tables of numbers, one row a frame: CSV, Parquet, or the variables of a NetCDF file."""

from __future__ import annotations

import csv
import io
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseppl.errors import FilePath, InputError
from poseppl.files.bounded_reading import check_file, read_text
from poseppl.files.netcdf_reading import read_netcdf

_EXPECTED = "a table of numbers: NAME.csv, NAME.parquet or NAME.nc"
_MISSING = ("", "na", "nan", "null", "none")
"""What stands for a number that is missing, in any case."""
_MOST_BYTES = 2**30


def read_table(path: FilePath) -> dict[str, NDArray[Any]]:
    """Read the columns of a table.

    Args:
        path: A .csv file with a head, a .parquet file, or a .nc file of variables (T, ...).

    Returns:
        Columns (T,), or variables (T, ...), by name; NaN where a number is missing.

    Raises:
        InputError: The file is of another kind, cannot be read, or holds what is no number; says where.
    """
    kind = Path(path).suffix.lower()
    if kind == ".csv":
        return _columns_of_csv(path)
    if kind in (".parquet", ".pq"):
        return _columns_of_parquet(path)
    if kind == ".nc":
        tree = read_netcdf(path, expected=_EXPECTED)
        return {str(name): _numbers(path, str(name), values.values) for name, values in tree.dataset.variables.items()}
    raise InputError(f"a file of the kind {kind or 'of no kind'!r}", file=path, expected=_EXPECTED)


def _columns_of_csv(path: FilePath) -> dict[str, NDArray[Any]]:
    head, *rows = list(csv.reader(io.StringIO(read_text(path)), skipinitialspace=True)) or [[]]
    names = [name.strip() for name in head]
    if len(set(names)) < len(names) or "" in names or not names:
        raise InputError(f"its head is {head}", file=path, line=1, expected="a name for each column, all different")
    values = np.full((len(rows), len(names)), np.nan)
    filled = [(line, row) for line, row in enumerate(rows, 2) if row]
    for index, (line, row) in enumerate(filled):
        if len(row) != len(names):
            raise InputError(f"{len(row)} fields", file=path, line=line, expected=f"{len(names)}, as its head has")
        for column, word in enumerate(row):
            values[index, column] = _number(path, line, names[column], word.strip())
    if not filled:
        raise InputError("no row below its head", file=path, expected="a row for each frame")
    return dict(zip(names, values[: len(filled)].T, strict=True))


def _number(path: FilePath, line: int, field: str, word: str) -> float:
    if word.lower() in _MISSING:
        return float("nan")
    try:
        return float(word)
    except ValueError:
        raise InputError(
            f"{word!r}", file=path, line=line, field=field, expected="a number, or nothing where none is"
        ) from None


def _columns_of_parquet(path: FilePath) -> dict[str, NDArray[Any]]:
    source = check_file(path, max_bytes=_MOST_BYTES)
    try:
        parquet: Any = import_module("pyarrow.parquet")
    except ImportError:
        raise InputError("Parquet needs pyarrow", file=path, expected="pip install 'poseppl[tables]', or a CSV file") from None
    try:
        whole = parquet.read_metadata(source)
        size = sum(whole.row_group(index).total_byte_size for index in range(whole.num_row_groups))
    except Exception as error:  # pyarrow's own errors, of which there are many
        raise InputError(f"no Parquet: {error}", file=path, expected=_EXPECTED) from error
    if size > _MOST_BYTES:
        raise InputError(f"declares {size / 2**20:.0f} MiB", file=path, expected=f"at most {_MOST_BYTES // 2**20} MiB unpacked")
    try:
        table = parquet.read_table(source)
    except Exception as error:  # pyarrow's own errors, of which there are many
        raise InputError(f"no Parquet: {error}", file=path, expected=_EXPECTED) from error
    return {name: _numbers(path, name, table[name].to_pandas().to_numpy()) for name in table.column_names}


def _numbers(path: FilePath, name: str, values: NDArray[Any]) -> NDArray[Any]:
    if values.dtype.kind not in "fiub" or values.ndim == 0:
        raise InputError(f"{values.dtype} of shape {values.shape}", file=path, field=name, expected="numbers, one row a frame")
    return values
