"""Fields of tables of comma-separated values (CSV): rows, decimal numbers by one rule, and texts that spreadsheets would run.

A spreadsheet takes a cell that begins with ``=``, ``+``, ``-``, ``@``, a tab or a line end for a formula, which may call
programs and servers. A name from a file of somebody else's may be one. An apostrophe before it makes a text of it.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Iterator
from typing import Any

from poseppl.errors import FilePath, Location
from poseppl.files.bounded_reading import read_text

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


_FORMULA = re.compile("'*[=+\\-@\t\n\uff1d\uff0b\uff0d\uff20]")  # the last four are those of full width


def shielded(cell: Any) -> Any:
    """A cell as CSV files have it: an apostrophe before a text that begins as a formula; numbers are not changed.

    A carriage return, at which Python's writer does not quote a text, and a spreadsheet begins a row, becomes a newline.

    >>> shielded("=1+1"), shielded("-1.5"), shielded(-1.5), shielded("hip")
    ("'=1+1", '-1.5', -1.5, 'hip')
    """
    if not isinstance(cell, str):
        return cell
    text = cell.replace("\r", "\n")
    formula = _FORMULA.match(text) and text != "-inf" and decimal_number(text) is None
    return f"'{text}" if formula else text


def unshielded(word: str) -> str:
    """The text that :func:`shielded` wrote.

    >>> unshielded(shielded("=1+1")), unshielded(shielded("'=1")), unshielded("'hip'")
    ('=1+1', "'=1", "'hip'")
    """
    return word[1:] if word.startswith("'") and _FORMULA.match(word) else word


MAX_LETTERS = 64
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?", re.ASCII)


def decimal_number(word: str) -> float | None:
    """The number that a word stands for, infinite beyond the range of float64; None if it is no number.

    Python's ``float`` also takes "nan", "infinity", "1_000" and the digits of other scripts.

    >>> decimal_number("-1.5e3"), decimal_number("1_000"), decimal_number("inf")
    (-1500.0, None, None)
    """
    return float(word) if len(word) <= MAX_LETTERS and _NUMBER.fullmatch(word) else None
