"""Names of the files that a command writes, checked before the work is done."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from poseppl.errors import InputError, cut
from poseppl.files.atomic_writing import atomic_path
from poseppl.motion.settings import ReadFrom, Settings, kinds_of


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
