"""Tables of comma-separated values (CSV), as the fields of each row."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator

from poseppl.errors import FilePath, Location
from poseppl.files.bounded_reading import read_text

Line = tuple[Location, list[str]]
"""Where a line stands, and its words."""


def rows_of_csv(path: FilePath, *, empty: bool = False) -> Iterator[Line]:
    """The fields of each row of a CSV file, without white space around them; all as many as the first.

    Args:
        path: The file.
        empty: Whether rows are wanted whose fields are all empty, too, and blank lines between rows as such rows.

    Raises:
        InputError: The file cannot be read, its quotes are malformed, or a row has more or fewer fields.
    """
    width, blank = 0, list[Location]()
    text = re.sub(r"(?m)^[ \t]+$", "", read_text(path))
    reader = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True, strict=True)
    while True:
        try:
            row = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise Location(path, reader.line_num).error(f"malformed CSV: {error}") from error
        values, at = [value.strip() for value in row], Location(path, reader.line_num)
        if empty and width and not values:
            blank.append(at)
        elif any(values) or (empty and values):
            width = width or len(values)
            if len(values) != width:
                raise at.error(f"{len(values)} values", f"{width}, one a column; the file may have been cut off")
            yield from ((place, [""] * width) for place in blank)  # those after the last row are none
            blank.clear()
            yield at, values
