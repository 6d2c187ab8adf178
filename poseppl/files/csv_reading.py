"""Tables of comma-separated values (CSV), as the fields of each row."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Iterator

from poseppl.errors import FilePath, Location
from poseppl.files.bounded_reading import read_text
from poseppl.files.csv_texts import unshielded

MAX_COLUMNS = 100_000
Line = tuple[Location, list[str]]
"""The number of a line, and its words."""


def rows_of_csv(path: FilePath, *, empty: bool = False) -> Iterator[Line]:
    """The fields of each row of a CSV file, without white space around them, nor an apostrophe before a formula.

    Args:
        path: The file.
        empty: Whether rows are wanted whose fields are all empty, too, and blank lines between rows as such rows.

    Raises:
        InputError: The file cannot be read, its quotes are malformed, or a row has too many fields, or more or fewer than the
            first.
    """
    width, blank = 0, list[Location]()
    text = re.sub(r"(?m)^[ \t]+$", "", read_text(path))
    reader = csv.reader(_bounded(path, io.StringIO(text, newline="")), skipinitialspace=True, strict=True)
    while True:
        try:
            row = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise Location(path, reader.line_num).error(f"malformed CSV: {error}") from error
        values, at = [unshielded(value.strip()) for value in row], Location(path, reader.line_num)
        if empty and width and not values:
            blank.append(at)
        elif any(values) or (empty and values):
            width = width or len(values)
            if len(values) != width:
                raise at.error(f"{len(values)} values", f"{width}, one a column; the file may have been cut off")
            yield from ((place, [""] * width) for place in blank)  # those after the last row are none
            blank.clear()
            yield at, values


def _bounded(path: FilePath, lines: Iterable[str]) -> Iterator[str]:
    """The lines; of so many fields that they would take many times the memory of the file, an error."""
    for number, line in enumerate(lines, start=1):
        if line.count(",") >= MAX_COLUMNS:
            raise Location(path, number).error(f"more than {MAX_COLUMNS} values", "fewer columns")
        yield line
