"""Tables of numbers, one row a frame: CSV, Parquet, or the variables of a NetCDF file."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseppl.errors import FilePath, Location
from poseppl.files.bounded_reading import check_file
from poseppl.files.csv_reading import rows_of_csv
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
        variables = {str(name): values.values for name, values in tree.dataset.variables.items()}
        return {name: _numbers(Location(path, field=name), values) for name, values in variables.items()}
    raise Location(path).error(f"a file of the kind {kind or 'of no kind'!r}", _EXPECTED)


def _columns_of_csv(path: FilePath) -> dict[str, NDArray[Any]]:
    (at, names), *rows = list(rows_of_csv(path, empty=True)) or [(Location(path), [])]
    if len(set(names)) < len(names) or "" in names or not names:
        raise at.error(f"its head is {names}", "a name for each column, all different")
    if not rows:
        raise Location(path).error("no row below its head", "a row for each frame")
    values = [[_number(here.in_field(name), word) for name, word in zip(names, row, strict=True)] for here, row in rows]
    return dict(zip(names, np.array(values).T, strict=True))


def _number(at: Location, word: str) -> float:
    if word.lower() in _MISSING:
        return float("nan")
    try:
        return float(word)
    except ValueError:
        raise at.error(f"{word!r}", "a number, or nothing where none is") from None


def _columns_of_parquet(path: FilePath) -> dict[str, NDArray[Any]]:
    source, at = check_file(path, max_bytes=_MOST_BYTES), Location(path)
    try:
        parquet: Any = import_module("pyarrow.parquet")
    except ImportError:
        raise at.error("Parquet needs pyarrow", "pip install 'poseppl[tables]', or a CSV file") from None
    try:
        whole = parquet.read_metadata(source)
        size = sum(whole.row_group(index).total_byte_size for index in range(whole.num_row_groups))
        table = parquet.read_table(source) if size <= _MOST_BYTES else None
    except Exception as error:  # pyarrow's own errors, of which there are many
        raise at.error(f"no Parquet: {error}", _EXPECTED) from error
    if table is None:
        raise at.error(f"declares {size / 2**20:.0f} MiB", f"at most {_MOST_BYTES // 2**20} MiB unpacked")
    return {name: _numbers(at.in_field(name), table[name].to_pandas().to_numpy()) for name in table.column_names}


def _numbers(at: Location, values: NDArray[Any]) -> NDArray[Any]:
    if values.dtype.kind not in "fiub" or values.ndim == 0:
        raise at.error(f"{values.dtype} of shape {values.shape}", "numbers, one row a frame")
    return values
