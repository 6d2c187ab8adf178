"""Tables of runs that are written row by row, so that what is there need not be run again."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from poseppl_papers.tables import Table, write_csv


def read_runs(path: Path) -> list[tuple[str, ...]]:
    """The rows of a table of runs, none if there is no such file."""
    if not path.is_file():
        return []
    with path.open(newline="") as file:
        return [tuple(row) for row in csv.reader(file)][1:]


def keep_run(table: Table, row: Sequence[Any], output: Path) -> None:
    """Add a row, print it and write the table."""
    table.rows.append(tuple(row))
    write_csv(table, output)
    print(*row, flush=True)
