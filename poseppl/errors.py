"""Errors that a user can mend: one message that says what is wrong, where, and what was expected."""

from __future__ import annotations

from os import PathLike
from typing import NamedTuple

FilePath = str | PathLike[str]


class PosepplError(Exception):
    """Base of the errors that the command line reports in one message, without a traceback."""


class InputError(PosepplError):
    """Bad input: a file, an option or an array that cannot be used.

    Args:
        problem: What is wrong, in one sentence.
        file: The file that it was found in.
        line: The 1-based line in that file.
        field: The field, option, column or site.
        expected: What was expected, and how to mend it.
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
        where = [str(part) for part in (file, f"line {line}" if line else None, field) if part is not None]
        message = f"{', '.join(where)}: {problem}" if where else problem
        told = f"{message} (expected {expected})" if expected else message
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
        value: What it was set to.
        problem: What is wrong, or what was expected.
    """

    def __init__(self, name: str, value: object, problem: str) -> None:
        super().__init__(problem, field=f"{name}={value}")
