"""Errors that a user can correct: one message that says what is wrong, where, and what was expected.

Messages name arguments as data, so that Python shows an argument and the command line its option:

>>> message = Phrase("the clock is late (", Argument("offset"), " sets it)")
>>> message, worded(message, lambda argument: f"--{argument.name}")
('the clock is late (offset sets it)', 'the clock is late (--offset sets it)')
"""

from __future__ import annotations

import reprlib
from collections.abc import Callable
from os import PathLike
from typing import Any, NamedTuple

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


class _Word(str):
    """A word that messages quote without quotation marks."""

    __repr__ = str.__str__


class Argument(NamedTuple):
    """An argument that a message names.

    Attributes:
        name: Its name in Python.
        value: The value to give it; None where the message names none.
        setting: Whether it is a setting of the filter or the smoother.
    """

    name: str
    value: Any = None
    setting: bool = False

    def __str__(self) -> str:
        return self.name if self.value is None else f"{self.name}={brief(self.value)}"


Wording = Callable[[Argument], str]
"""How an argument is shown."""


class Phrase(str):
    """Words that name arguments; as a string, these are worded as Python has them.

    Args:
        *parts: Words, arguments, and other phrases.
    """

    parts: tuple[str | Argument, ...]

    def __new__(cls, *parts: str | Argument) -> Phrase:
        """Join the parts."""
        flat = [each for part in parts for each in (part.parts if isinstance(part, Phrase) else (part,))]
        made = super().__new__(cls, "".join(map(str, flat)))
        made.parts = tuple(flat)
        return made


def worded(message: object, name: Wording) -> str:
    """A message, which may be an error, with its arguments as a function words them."""
    text = message.message if isinstance(message, PosepplError) else message
    if not isinstance(text, Phrase):
        return str(text)
    return "".join(name(part) if isinstance(part, Argument) else part for part in text.parts)


class PosepplError(Exception):
    """Base of the errors that the command line reports in one message, without a traceback."""

    @property
    def message(self) -> str:
        """The message, which may be a :class:`Phrase`."""
        return self.args[0] if self.args and isinstance(self.args[0], Phrase) else str(self)


class InputError(PosepplError):
    """Bad input: a file, an argument or an array that cannot be used.

    Args:
        problem: The problem, in one sentence.
        file: The file that it was found in.
        line: The 1-based line in that file.
        field: The field, argument, column or site.
        expected: The expected input, and how to correct it.
    """

    def __init__(
        self,
        problem: str,
        *,
        file: FilePath | None = None,
        line: int | None = None,
        field: str | Argument | None = None,
        expected: str | None = None,
    ) -> None:
        place = ((file, _MAX_FILE), (f"line {line}" if line else None, _MAX_FIELD), (field, _MAX_FIELD))
        parts: list[str | Argument] = []
        for part, length in place:
            parts += [", " * bool(parts), _cut_part(part, length)] if part is not None else []
        parts += [": " * bool(parts), _cut_part(problem, MAX_MESSAGE)]
        parts += [" (expected ", _cut_part(expected, MAX_MESSAGE), ")"] if expected else []
        super().__init__(Phrase(*(part if isinstance(part, Argument) else _printable(part) for part in Phrase(*parts).parts)))


def _cut_part(part: object, length: int) -> str | Argument:
    return part if isinstance(part, Argument | Phrase) and len(str(part)) <= length else cut(part, length)


def _printable(text: str) -> str:
    return "".join(letter if letter.isprintable() else "?" for letter in text)


class UnsuitableModelError(PosepplError, ValueError):
    """A model that the chosen algorithm cannot serve; the message says what it lacks, and which algorithms need less."""


class Location(NamedTuple):
    """A place in the input, for messages: a file, a line of it, a field; None is what is not known."""

    file: FilePath | None = None
    line: int | None = None
    field: str | Argument | None = None

    def in_line(self, line: int) -> Location:
        """A line of this file."""
        return Location(self.file, line, self.field)

    def in_field(self, field: str | Argument) -> Location:
        """A field here."""
        return Location(self.file, self.line, field)

    def error(self, problem: str, expected: str | None = None) -> InputError:
        """The error that something here is wrong."""
        return InputError(problem, file=self.file, line=self.line, field=self.field, expected=expected)


class SettingError(InputError):
    """A setting of an algorithm that it does not take.

    Args:
        name: The setting, an argument of the algorithm.
        value: Its value.
        problem: The problem, or the expected values.
    """

    def __init__(self, name: str, value: object, problem: str) -> None:
        super().__init__(problem, field=Argument(name, _Word("None") if value is None else value, setting=True))
