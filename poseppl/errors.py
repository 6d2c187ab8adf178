"""Errors that a user can correct: one message that says what is wrong, where, and what was expected."""

from __future__ import annotations

import reprlib
from os import PathLike
from typing import NamedTuple

FilePath = str | PathLike[str]
MAX_MESSAGE = 1000
"""Characters of what is wrong, and of what is expected, in an error."""
MAX_SHOWN = 4000
"""Characters of any text that the command line shows at once."""
_MAX_VALUE, _MAX_FIELD, _MAX_FILE = 80, 120, 400


class _Repr(reprlib.Repr):
    """A representation that visits no more of a value than it shows."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxstring, self.maxlong, self.maxother = 3, _MAX_VALUE, _MAX_VALUE, _MAX_VALUE

    def repr_int(self, x: int, level: int) -> str:
        """An integer; Python refuses to write those of thousands of digits."""
        return super().repr_int(x, level) if x.bit_length() < 1000 else f"an integer of {x.bit_length()} bits"


_REPR = _Repr()


def cut(text: object, length: int = MAX_MESSAGE) -> str:
    """A text of at most so many characters: the middle of a longer one becomes three dots.

    >>> cut("0123456789", 7)
    '01...89'
    """
    whole = str(text)
    if len(whole) <= length:
        return whole
    start, end = (length - 2) // 2, (length - 3) // 2
    return f"{whole[:start]}...{whole[len(whole) - end :]}"


def brief(value: object) -> str:
    """A value as messages quote it: as ``repr``, of at most 80 characters.

    >>> brief("knee"), brief([1] * 1000)
    ("'knee'", '[1, 1, 1, 1, 1, 1, ...]')
    """
    return cut(_REPR.repr(value), _MAX_VALUE)


class PosepplError(Exception):
    """Base of the errors that the command line reports in one message, without a traceback."""


class InputError(PosepplError):
    """Bad input: a file, an option or an array that cannot be used.

    Args:
        problem: The problem, in one sentence.
        file: The file that it was found in.
        line: The 1-based line in that file.
        field: The field, option, column or site.
        expected: The expected input, and how to correct it.
    """

    def __init__(
        self,
        problem: str,
        *,
        file: FilePath | None = None,
        line: int | None = None,
        field: str | None = None,
        expected: str | None = None,
    ) -> None:
        place = ((file, _MAX_FILE), (f"line {line}" if line else None, _MAX_FIELD), (field, _MAX_FIELD))
        where = [cut(part, length) for part, length in place if part is not None]
        message = f"{', '.join(where)}: {cut(problem)}" if where else cut(problem)
        told = f"{message} (expected {cut(expected)})" if expected else message
        super().__init__("".join(letter if letter.isprintable() else "?" for letter in told))


class UnsuitableModelError(PosepplError, ValueError):
    """A model that the chosen algorithm cannot serve; the message says what it lacks, and which algorithms need less."""


class Location(NamedTuple):
    """A place in the input, for messages: a file, a line of it, a field; None is what is not known."""

    file: FilePath | None = None
    line: int | None = None
    field: str | None = None

    def in_line(self, line: int) -> Location:
        """A line of this file."""
        return Location(self.file, line, self.field)

    def in_field(self, field: str) -> Location:
        """A field here."""
        return Location(self.file, self.line, field)

    def error(self, problem: str, expected: str | None = None) -> InputError:
        """The error that something here is wrong."""
        return InputError(problem, file=self.file, line=self.line, field=self.field, expected=expected)


class SettingError(InputError):
    """A setting of an algorithm that it does not take; the command line writes ``--set`` before the message.

    Args:
        name: The setting, an argument of the algorithm.
        value: Its value.
        problem: The problem, or the expected values.
    """

    def __init__(self, name: str, value: object, problem: str) -> None:
        super().__init__(problem, field=f"{name}={value}")
