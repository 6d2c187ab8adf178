"""Tables of a folder, and how each was made: CSV files and one record of them, tables.json.

A call that makes some of the tables keeps the others. So a page made from the folder lists all tables, each with its own number
of runs, recordings, date and versions.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from poseppl.errors import InputError
from poseppl.files.atomic_writing import write_atomically
from poseppl.files.csv_texts import unshielded
from poseppl_papers.tables import Table, write_csv

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
