"""Words and numbers of text files: what a reader takes for one, and what it refuses by line."""

from __future__ import annotations

import re
from array import array
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location
from poseppl.files.csv_reading import Line

LARGEST = 1e9
LONGEST = 200
NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?", re.ASCII)


def some(names: Iterable[str], count: int = 8) -> str:
    """The first few of many names, for a message."""
    listed = [name if len(name) <= 40 else name[:37] + "..." for name in names]
    return ", ".join(listed[:count]) + (f", ... ({len(listed)} in all)" if len(listed) > count else "")


def lines_of_words(path: FilePath, text: str) -> Iterator[Line]:
    """The words of each line that has any, one line at a time: those of a text take many times its memory.

    Raises:
        InputError: A word has more than 200 characters, which no name or number has.
    """
    for number, line in enumerate(text.split("\n"), start=1):
        at, words = Location(path, number), line.split()
        for word in words if len(line) > LONGEST else ():
            if len(word) > LONGEST:
                raise at.error(f"{word[:20]!r}... has {len(word)} characters", f"at most {LONGEST}")
        if words:
            yield at, words


def number_rows(lines: Iterable[Line], columns: Sequence[str], most: int) -> Floats:
    """Rows of numbers as an array (T, columns).

    Args:
        lines: The rows.
        columns: Names of the numbers in a row.
        most: Numbers in all.

    Raises:
        InputError: A row has more or fewer numbers, there are too many in all, or one is none.
    """
    values = array("d")
    for at, words in lines:
        if len(words) != len(columns):
            expected = f"{len(columns)}, {columns[0][:40]} to {columns[-1][:40]}; the file may have been cut off"
            raise at.error(f"{len(words)} values", expected)
        values.extend(parse_number(word, at.in_field(name)) for word, name in zip(words, columns, strict=True))
        if len(values) > most:
            raise at.error("too many values", f"at most {most}")
    return np.array(values).reshape(-1, len(columns))


def parse_frame(token: str, at: Location) -> int:
    """Parse the number of a frame, of at most nine digits."""
    if not re.fullmatch("[0-9]{1,9}", token):
        raise at.in_field("frame").error(f"{token[:40]!r} is no frame number", "0, 1, 2, ...")
    return int(token)


def check_distinct(names: Sequence[str], kind: str, at: Location) -> None:
    """Check that no two of a kind have the same name."""
    for name, count in Counter(names).items():
        if count > 1:
            raise at.error(f"two {kind} are called {name!r}")


def parse_number(token: str, at: Location) -> float:
    """Parse one finite decimal number.

    Python's own ``float`` would also take "nan", "infinity", "1_000" and the digits of other scripts.

    Args:
        token: The text, without white space around it.
        at: Where it stands, for the message.

    Returns:
        The number.

    Raises:
        InputError: The text is no number, or its magnitude is above 1e9.
    """
    if len(token) <= 64 and NUMBER.fullmatch(token):
        number = float(token)
        if abs(number) <= LARGEST:
            return number
        raise at.error(f"the number {token} is too large", "at most 1e9")
    shown = token if len(token) <= 40 else token[:37] + "..."
    raise at.error(f"{shown!r} is not a number", "a finite decimal number")


def parse_numbers(tokens: list[str], at: Location) -> list[float]:
    """Parse several numbers of one line; see `parse_number`."""
    return [parse_number(token, at) for token in tokens]


def finite_numbers(value: Any, names: Collection[str], at: Location) -> dict[str, float]:
    """Check that what a file holds is a mapping of known names to finite numbers.

    Args:
        value: What JSON or TOML gave.
        names: The known names.
        at: Where it stands, for the message.

    Returns:
        The numbers by name.

    Raises:
        InputError: It is no mapping, a name is unknown, or a value is no number or its magnitude is above 1e9.
    """
    if not isinstance(value, dict):
        raise at.error("no numbers by name", "a mapping of names to numbers")
    for name, number in value.items():
        if name not in names:
            raise at.error(f"unknown name {str(name)[:40]!r}", some(names))
        if isinstance(number, bool) or not isinstance(number, int | float) or not abs(number) <= LARGEST:
            raise at.error(f"{name} is {str(number)[:40]!r}", "a finite number, at most 1e9")
    return {name: float(number) for name, number in value.items()}
