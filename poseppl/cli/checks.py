"""Checks of a command's words and of the files that it reads and writes, before anything heavy is imported.

Options have these types, so that each is checked where it is declared. Numbers, names and ranges are checked as the command is
parsed, files by :func:`check_inputs`, after the command has checked which options go together.
"""

from __future__ import annotations

import glob
import importlib.util
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import click

from poseppl.errors import InputError, Location, brief, cut
from poseppl.files.atomic_writing import atomic_path
from poseppl.files.bounded_reading import check_file
from poseppl.files.frame_range import FrameRange
from poseppl.motion.settings import ReadFrom, Settings, kinds_of

Check = Callable[[Any, str], object]
"""Refuses a value of the option whose name is the second argument, by an :class:`~poseppl.errors.InputError`."""


class Checked(click.ParamType):  # type: ignore[type-arg]
    """A value that is checked when it is parsed.

    Args:
        check: The check.
        kind: Type that it is parsed as.
    """

    name = "value"

    def __init__(self, check: Check, kind: Any = click.STRING) -> None:
        self._check, self._kind = check, kind

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Read and check it, as click does."""
        read = self._kind.convert(value, param, ctx)
        self._check(read, "" if param is None else option_name(param))
        return read


def number(expected: str, accepts: Callable[[float], bool], kind: Any = click.FLOAT) -> Checked:
    """A number, of which only some are accepted; NaN is in no range."""

    def check(value: float, option: str) -> None:
        if not accepts(value):
            raise InputError(f"{value:g}", field=option, expected=expected)

    return Checked(check, kind)


def _check_builder(name: str, option: str) -> None:
    """Refuse what names no builder, or one of a file or a package that is not there; none of the user's code is run."""
    known = {entry.name: entry.value for entry in entry_points(group="poseppl.models")} if ":" not in name else {}
    place, colon, _ = known.get(name, name).rpartition(":")
    if not colon:
        raise InputError(f"{brief(name)} names no builder", field=option, expected="package.module:builder or file.py:builder")
    check_code(place, option)


def check_code(place: str, option: str) -> None:
    """Refuse Python code, ``file.py`` or ``package.module``, whose file or package is not there.

    Raises:
        InputError: It is not there.
    """
    if place.endswith(".py"):
        check_file(place, max_bytes=sys.maxsize)
    elif importlib.util.find_spec(place.partition(".")[0] or "?") is None:
        raise InputError(
            f"no package {brief(place.partition('.')[0])}", field=option, expected="an installed package, or FILE.py"
        )


BUILDER = Checked(_check_builder)
FRAMES = Checked(lambda text, option: FrameRange.parse(text))
RATE = number("a positive number of frames a second", lambda rate: 0 < rate < 1e6)


class InputFile(click.Path):
    """A file that a command reads.

    Args:
        folders: Whether it may be a folder, or a pattern of files.
        paths: The paths in a word of the command line, such as ``NAME=FILE``.
    """

    def __init__(self, *, folders: bool = False, paths: Callable[[str], Iterable[str]] = lambda word: [word]) -> None:
        super().__init__(readable=False)  # check says more than click does
        self._folders, self._paths = folders, paths

    def check(self, word: str, option: str) -> None:
        """Refuse a word whose files are not there, are empty, or cannot be read.

        Raises:
            InputError: One of them is such.
        """
        for path in self._paths(word):
            if self._folders and (os.path.isdir(path) or (glob.has_magic(path) and not os.path.exists(path))):
                continue
            check_file(path, max_bytes=sys.maxsize)
            if not os.access(path, os.R_OK):
                raise Location(path, field=option).error("cannot be read: Permission denied", "read permission")


def file_of_pair(word: str) -> list[str]:
    """The file of ``NAME=FILE``, or of ``FILE``."""
    name, equals, path = word.partition("=")
    return [path if equals else name]


def words_of_files(words: Iterable[str]) -> dict[str, str]:
    """The files of CAMERA=FILE, by camera.

    Raises:
        InputError: A word has another form, or a camera comes twice.
    """
    found: dict[str, str] = {}
    for word in words:
        camera, equals, path = str(word).partition("=")
        if not (camera and equals and path):
            raise InputError(brief(word), field="FILES", expected="CAMERA=FILE, such as cam1=pose/cam1_json")
        if camera in found:
            raise InputError(f"the camera {brief(camera)} comes twice", field="FILES", expected="each camera once")
        found[camera] = path
    return found


def files_of_recording(word: str) -> list[str]:
    """The files of ``FILE[,SKELETON]``."""
    return [part for part in word.split(",") if part]


def option_name(parameter: click.Parameter) -> str:
    """An option as the user writes it, an argument as help does."""
    return max(parameter.opts, key=len) if isinstance(parameter, click.Option) else str(parameter.name).upper()


def check_inputs() -> None:
    """Refuse input files of the command that is running which are not there or cannot be read.

    Raises:
        InputError: One of them is such.
    """
    context = click.get_current_context()
    for parameter in context.command.params:
        kind, given = parameter.type, context.params.get(parameter.name or "")
        if isinstance(kind, InputFile) and given is not None:
            for word in given if isinstance(given, tuple) else [given]:
                kind.check(word, option_name(parameter))


def check_recording(path: str | None, skeleton: str | None) -> None:
    """Refuse a recording whose suffix is that of no format, or which needs a skeleton.

    Raises:
        InputError: It is such.
    """
    from poseppl.declarations import declared

    suffixes = declared("poseppl.motion.io.recording", "SUFFIXES")
    suffix = suffixes[0] if path is None else Path(path).suffix.lower()
    if suffix not in suffixes:
        raise Location(path).error(f"unknown format {suffix!r}", " or ".join(suffixes))
    if path is not None and suffix == ".amc" and skeleton is None:
        raise Location(path).error("an .amc file needs its skeleton", "--skeleton FILE.asf, or FILE.amc,FILE.asf")


def rows_of_text(text: str | None) -> slice:
    """Rows A:B:C of a table.

    Raises:
        InputError: It is something else.
    """
    parts = (text or ":").split(":")
    try:
        numbers = [int(part) if part else None for part in parts]
    except ValueError:
        numbers = []
    if not 1 < len(numbers) < 4 or (len(numbers) == 3 and numbers[2] is not None and numbers[2] < 1):
        raise InputError(brief(text), field="--frames", expected="A:B or A:B:C, such as 0:200:2")
    return slice(*numbers)


def check_rows(text: str, option: str) -> None:
    """Refuse what are no rows of a table, as :func:`rows_of_text` does."""
    rows_of_text(text)


@contextmanager
def contents_of(*results: str | Path) -> Iterator[None]:
    """Tell the user that a result's contents are not what the block wants, where they are not.

    A result that opens may still lack a variable, or have one of another type or shape.

    Args:
        results: The files that the block works on.

    Raises:
        InputError: The block ended in an error that wrong contents bring about.
    """
    try:
        yield
    except (AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
        reason = cut((str(error).strip().splitlines() or [""])[0], 120)
        expected = "a result as poseppl track or smooth wrote it; if it is one, --debug shows where this came up"
        raise InputError(
            f"its contents cannot be used: {type(error).__name__}: {reason}",
            file=", ".join(map(str, results)),
            expected=expected,
        ) from error


class _Writable(Exception):
    """Ends the trial of an output."""


def output_path(given: str | None, stem: str, suffix: str) -> Path:
    """Destination of a result.

    Args:
        given: A folder that exists, a file name, or None for the current folder.
        stem: Name of the file without its suffix, unless one is given.
        suffix: Suffix of the file.

    Raises:
        InputError: The name has another suffix.
    """
    if given is None:
        return Path(stem + suffix)
    path = Path(given)
    if path.is_dir() or given.endswith("/"):
        return path / (stem + suffix)
    if path.suffix != suffix:
        raise InputError("not a name for the result", file=given, field="--output", expected=f"NAME{suffix}, or a folder")
    return path


def stem_of(recording: str | None, person: int | None = None) -> str:
    """Name of the outputs; another one for each person of a recording."""
    stem = "poseppl-walk" if recording is None else f"poseppl-{Path(recording).stem}"
    return stem if person in (None, 1) else f"{stem}-person{person}"


def files_read(settings: Settings) -> Iterator[str]:
    """The files that settings name, those of the first field first."""
    yield from map(str, getattr(settings, "files", {}).values())
    for name, kind in kinds_of(type(settings)).items():
        if isinstance(kind.condition, ReadFrom) or (kind.condition and kind.or_file):
            values = [value for value in kind.values(getattr(settings, name)) if isinstance(value, str)]
            yield from ((value.partition("=")[2] or value) if kind.several else value for value in values)


def output_folder(given: str | None, result: str) -> Path:
    """The folder of --output; by default that of a result.

    Raises:
        InputError: It is not there.
    """
    folder = Path(result).parent if given is None else Path(given)
    if not folder.is_dir():
        raise InputError("not a folder", file=folder, field="--output", expected="a folder that exists")
    return folder


def check_new_folder(path: str | Path, option: str) -> None:
    """Check that files can be written into a folder that may not be there yet, before the work is done.

    Raises:
        InputError: It is something else, or it cannot be made or written.
    """
    folder = Path(path).absolute()
    while not os.path.lexists(folder):
        folder = folder.parent
    if not folder.is_dir():
        raise InputError("not a folder", file=folder, field=option, expected="a folder, which need not exist yet")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError("the output folder cannot be written", file=folder, field=option, expected="write permission")


def tell_replaced(target: Path, progress: Any) -> None:
    """Tell the user, before the work is done, of a result that it replaces."""
    if target.exists():
        progress.note(f"{target}, which is there, is replaced at the end (--output gives another name)")


def check_writable(paths: Iterable[Path], inputs: Iterable[str | Path | None] = ()) -> None:
    """Check that files can be written, and are not among the inputs, before the work is done.

    Args:
        paths: The files.
        inputs: Files that must not be overwritten.

    Raises:
        InputError: A file cannot be written, or is an input.
        PosepplError: The disk is full.
    """
    sources = [source for source in inputs if source is not None]
    for path in paths:
        try:
            with atomic_path(path, inputs=sources) as temporary:
                temporary.write_bytes(b"poseppl")
                raise _Writable
        except _Writable:
            pass
