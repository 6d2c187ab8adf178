"""Tables of an experiment: the one form from which CSV, NetCDF, figures and pages are made; and the record of how each was.

A call that makes some of the tables keeps the others. So a page made from the folder lists all tables, each with its own number
of runs, recordings, date and versions.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import xarray as xr

from poseppl.errors import InputError
from poseppl.files.atomic_writing import write_atomically, write_rows
from poseppl.files.csv_fields import unshielded
from poseppl.files.netcdf import write_netcdf as write_tree

Item = TypeVar("Item")
Key = TypeVar("Key", bound=Hashable)


class Table(NamedTuple):
    """Rows under named columns.

    Attributes:
        name: Name of the table and its file.
        columns: Names.
        rows: One value for each column: texts, integers or floats.
        about: Meaning of the columns, in a sentence or two.
    """

    name: str
    columns: tuple[str, ...]
    rows: list[tuple[Any, ...]]
    about: str = ""

    def column(self, name: str, **where: Any) -> np.ndarray[Any, Any]:
        """The values of a column in the rows whose other columns have the given values."""
        index = self.columns.index(name)
        return np.array([row[index] for row in self.select(**where)])

    def select(self, **where: Any) -> list[tuple[Any, ...]]:
        """The rows whose columns have the given values."""
        wanted = [(self.columns.index(name), value) for name, value in where.items()]
        return [row for row in self.rows if all(row[index] == value for index, value in wanted)]

    def records(self, **where: Any) -> list[dict[str, Any]]:
        """The same rows by the names of their columns."""
        return [dict(zip(self.columns, row, strict=True)) for row in self.select(**where)]

    def values(self, name: str, **where: Any) -> list[Any]:
        """The different values of a column in those rows, in their order."""
        index = self.columns.index(name)
        return list(dict.fromkeys(row[index] for row in self.select(**where)))


def rows_of(tables: Mapping[str, Table], name: str, **where: Any) -> list[dict[str, Any]]:
    """The rows of a table whose columns have the given values, as records; none where there is no such table."""
    return tables[name].records(**where) if name in tables else []


def grouped(items: Iterable[Item], key: Callable[[Item], Key]) -> dict[Key, list[Item]]:
    """Rows, jobs or whatever by a key of theirs, in their order."""
    groups: dict[Key, list[Item]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return groups


def write_csv(table: Table, folder: Path) -> None:
    """Write a table as FOLDER/NAME.csv, with six significant digits."""
    write_rows(folder / f"{table.name}.csv", [table.columns, *(map(shown, row) for row in table.rows)])


def shown(value: Any) -> str:
    """A value as the CSV has it."""
    return f"{value:.6g}" if isinstance(value, float | np.floating) else str(value)


def write_netcdf(tables: Iterable[Table], path: Path) -> None:
    """Write tables as one NetCDF file, a group each."""
    groups = {table.name: _dataset(table) for table in tables}
    write_tree(xr.DataTree.from_dict(groups), path)


def _dataset(table: Table) -> xr.Dataset:
    columns: dict[str, tuple[str, Any]] = {}
    for index, name in enumerate(table.columns):
        values = np.array([row[index] for row in table.rows])
        columns[name] = ("row", values.astype(str).astype(object) if values.dtype.kind in "UO" else values)
    return xr.Dataset(columns, attrs={"about": table.about})


def markdown(columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A Markdown table, floats with three significant digits; nothing for no rows."""
    lines = [f"| {' | '.join(columns)} |", "|" + " --- |" * len(columns)]
    for row in rows:
        cells = (f"{value:.3g}" if isinstance(value, float | np.floating) else str(value) for value in row)
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) if lines[2:] else ""


RECORD = "tables.json"


class Provenance(NamedTuple):
    """How a table was made.

    Attributes:
        runs: How many runs it sums up, and whether those are the paper's numbers.
        recordings: Recordings of the people that were seen.
        date: Day on which the table was written, ISO 8601.
        versions: Libraries with their versions.
        command: The command line that makes it again.
        note: Note for the reader; may be empty.
    """

    runs: str
    recordings: str
    date: str
    versions: str
    command: str
    note: str = ""


class Kept(NamedTuple):
    """A table and how it was made."""

    table: Table
    made: Provenance


def write_folder(folder: Path, made: Mapping[str, Kept]) -> None:
    """Write tables as CSV, and their record; tables that are there already and not among these stay.

    Raises:
        InputError: The record of those that are there cannot be read.
    """
    record = _record(folder)
    for name, (table, how) in made.items():
        write_csv(table, folder)
        record[name] = {"about": table.about, **how._asdict()}
    write_atomically(folder / RECORD, json.dumps(record, indent=1) + "\n")


def read_folder(folder: Path) -> dict[str, Kept]:
    """The tables that the record names, as their files have them.

    Raises:
        InputError: The record or a table cannot be read.
    """
    return {name: _read(folder / f"{name}.csv", name, dict(how)) for name, how in _record(folder).items()}


def _record(folder: Path) -> dict[str, Any]:
    path = folder / RECORD
    if not path.exists():
        return {}
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")).items())
    except (ValueError, OSError, AttributeError) as error:
        raise InputError("damaged", file=path, expected="a record as it was written; remove it and run again") from error


def _read(path: Path, name: str, how: dict[str, Any]) -> Kept:
    try:
        with path.open(newline="", encoding="utf-8") as file:
            columns, *rows = csv.reader(file)
        table = Table(name, tuple(columns), [tuple(_value(cell) for cell in row) for row in rows], how.pop("about"))
        return Kept(table, Provenance(**how))
    except (OSError, ValueError, KeyError, TypeError) as error:
        expected = f"a table as {RECORD} names it; remove both and run again"
        raise InputError(f"cannot be read ({error})", file=path, expected=expected) from error


def _value(cell: str) -> Any:
    """An integer, a float, or a text; the name of a recording as 02_01 is a text, though Python reads it as 201."""
    for kind in (int, float) if "_" not in cell else ():
        try:
            return kind(cell)
        except ValueError:
            continue
    return unshielded(cell)
