"""Words and numbers of text files: what a reader takes for one, and what it refuses by line."""

from __future__ import annotations

import re
from array import array
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location, brief, cut
from poseppl.files.csv_fields import Line, decimal_number

LARGEST = 1e9
LONGEST = 200


def some(names: Iterable[str], count: int = 8) -> str:
    """The first few of many names, for a message."""
    listed = [cut(name, 40) for name in names]
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
                raise at.error(f"{brief(word)} has {len(word)} characters", f"at most {LONGEST}")
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
            expected = f"{len(columns)}, {cut(columns[0], 40)} to {cut(columns[-1], 40)}; the file may have been cut off"
            raise at.error(f"{len(words)} values", expected)
        values.extend(parse_number(word, at.in_field(name)) for word, name in zip(words, columns, strict=True))
        if len(values) > most:
            raise at.error("too many values", f"at most {most}")
    return np.array(values).reshape(-1, len(columns))


def parse_frame(token: str, at: Location) -> int:
    """Parse the number of a frame, of at most nine digits."""
    if not re.fullmatch("[0-9]{1,9}", token):
        raise at.in_field("frame").error(f"{brief(token)} is no frame number", "0, 1, 2, ...")
    return int(token)


def check_distinct(names: Sequence[str], kind: str, at: Location) -> None:
    """Check that no two of a kind have the same name."""
    for name, count in Counter(names).items():
        if count > 1:
            raise at.error(f"two {kind} are called {brief(name)}")


def parse_number(token: str, at: Location) -> float:
    """Parse one finite decimal number.

    Args:
        token: The text, without white space around it.
        at: Position, for the message.

    Returns:
        The number.

    Raises:
        InputError: The text is no number, or its magnitude is above 1e9.
    """
    number = decimal_number(token)
    if number is None:
        raise at.error(f"{brief(token)} is not a number", "a finite decimal number")
    if abs(number) > LARGEST:
        raise at.error(f"the number {token} is too large", "at most 1e9")
    return number


def parse_numbers(tokens: list[str], at: Location) -> list[float]:
    """Parse several numbers of one line; see `parse_number`."""
    return [parse_number(token, at) for token in tokens]


def finite_numbers(value: Any, names: Collection[str], at: Location) -> dict[str, float]:
    """Check that what a file holds is a mapping of known names to finite numbers.

    Args:
        value: Value from JSON or TOML.
        names: The known names.
        at: Position, for the message.

    Returns:
        The numbers by name.

    Raises:
        InputError: It is no mapping, a name is unknown, or a value is no number or its magnitude is above 1e9.
    """
    if not isinstance(value, dict):
        raise at.error("no numbers by name", "a mapping of names to numbers")
    for name, number in value.items():
        if name not in names:
            raise at.error(f"unknown name {brief(name)}", some(names))
        if isinstance(number, bool) or not isinstance(number, int | float) or not abs(number) <= LARGEST:
            raise at.error(f"{name} is {brief(number)}", "a finite number, at most 1e9")
    return {name: float(number) for name, number in value.items()}
