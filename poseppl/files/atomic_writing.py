"""Writing files so that a reader never sees half of one, and locks of files and folders between processes.

A file appears under its name only when all of it is on the disk. It is written in the same folder under a temporary name,
flushed with ``fsync``, and moved to its name by ``os.replace``, which POSIX makes atomic. An error or Ctrl-C leaves the old
file unchanged. Leftovers of a killed writer under its temporary name are removed by the next writer of the file: writers have a
lock, which ends with them.

A lock belongs to an open descriptor (``flock``), so that a process that ends, by whatever signal, lets go of it: there is
nothing stale to clear.
"""

from __future__ import annotations

import csv
import errno
import fcntl
import glob
import os
import secrets
import shutil
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from poseppl.errors import FilePath, Location, PosepplError
from poseppl.files.csv_fields import shielded

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_STRAY_SECONDS = 60.0
"""Age from which a temporary file that nobody has locked is taken for a stray."""


def _check_target(path: FilePath, inputs: Iterable[FilePath]) -> Path:
    at = Location(path)
    try:
        target = Path(path).resolve()
        around = Location(target.parent)
        if target.is_dir():
            raise at.error("the output is a folder", "the name of a file")
        if target.exists() and not target.is_file():
            raise at.error("the output is not a regular file", "the name of a file")
        if not target.parent.is_dir():
            raise around.error("the output folder does not exist", "an existing folder")
        if not os.access(target.parent, os.W_OK | os.X_OK):
            raise around.error("the output folder cannot be written", "write permission")
        for source in inputs:
            if target == Path(source).resolve() or (target.exists() and Path(source).exists() and target.samefile(source)):
                raise at.error("the output would overwrite an input", "another name")
    except (OSError, ValueError, RuntimeError) as error:
        raise at.error(f"the output cannot be written: {error}") from error
    return target


def _is_full(error: OSError) -> bool:
    # HDF5 reports the disk's error in its message alone.
    return error.errno in _FULL or f"errno = {errno.ENOSPC}" in str(error) or os.strerror(errno.ENOSPC) in str(error)


def _flush(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def _temporary(target: Path, path: FilePath) -> Iterator[Path]:
    """Yield a temporary name beside a target, with its suffix; what is left of it is removed, as are strays."""
    stem, suffix = target.stem[:100], target.suffix
    remove_strays(target.parent, glob.escape(stem), glob.escape(suffix))
    temporary = target.with_name(f".{stem}.{secrets.token_hex(6)}.tmp{suffix}")
    try:
        yield temporary
        _flush(target.parent)
    except OSError as error:
        _tell(error, path)
        raise
    finally:
        shutil.rmtree(temporary, ignore_errors=True) if temporary.is_dir() else temporary.unlink(missing_ok=True)


_written: ContextVar[list[Path] | None] = ContextVar("written", default=None)


@contextmanager
def files_written() -> Iterator[list[Path]]:
    """Yield a list to which each file and folder is added that this module writes while the block runs.

    It has them under the names that the writers gave, each once, in their order. Other threads are not listened to.
    """
    found: list[Path] = []
    token = _written.set(found)
    try:
        yield found
    finally:
        _written.reset(token)


def _note_written(path: FilePath) -> None:
    listed = _written.get()
    if listed is not None and Path(path) not in listed:
        listed.append(Path(path))


@contextmanager
def atomic_path(path: FilePath, *, inputs: Iterable[FilePath] = ()) -> Iterator[Path]:
    """Yield a temporary name in the folder of a file; on success it becomes the file, on failure it is removed.

    Args:
        path: The file to write. A symbolic link is followed.
        inputs: Files that must not be overwritten.

    Yields:
        The temporary path, with the suffix of ``path``; the block writes and closes it.

    Raises:
        InputError: The folder is missing or cannot be written, or the output is an input, a folder or a device.
        PosepplError: The disk is full, or the block wrote nothing.
    """
    target = _check_target(path, inputs)
    with _temporary(target, path) as temporary, _locked(temporary):
        yield temporary
        if not temporary.is_file() or temporary.stat().st_size == 0:
            raise PosepplError(f"{path}: nothing was written")
        _flush(temporary)
        os.replace(temporary, target)
    _note_written(path)


def write_atomically(path: FilePath, content: str | bytes) -> None:
    """Write a file, whole or not at all; text as UTF-8, with question marks for what is no Unicode.

    Raises:
        InputError: The folder is missing or cannot be written, or the output is a folder or a device.
        PosepplError: The disk is full.
    """
    with atomic_path(path) as temporary:
        temporary.write_bytes(content.encode("utf-8", "replace") if isinstance(content, str) else content)


def write_rows(path: FilePath, rows: Iterable[Iterable[object]]) -> None:
    """Write rows as CSV, whole or not at all; errors are those of :func:`write_atomically`.

    Texts that a spreadsheet would take for a formula are written as :func:`poseppl.files.csv_fields.shielded` says.
    """
    safe = ([shielded(cell) for cell in row] for row in rows)
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8", errors="replace") as stream:
        csv.writer(stream, lineterminator="\n").writerows(safe)


@contextmanager
def _locked(temporary: Path) -> Iterator[None]:
    """Make a temporary file or open a temporary folder, and lock it while the block runs."""
    if not temporary.is_dir():
        temporary.touch(exist_ok=False)
    descriptor = None
    with suppress(OSError):  # a file system without locks: nobody will take it for a stray either
        descriptor = take_lock(temporary)
    try:
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


def remove_strays(folder: Path, stem: str, suffix: str = "", min_age: float = _STRAY_SECONDS) -> None:
    """Remove the temporary files and folders of writers that were killed.

    Args:
        folder: The folder of the files.
        stem: Pattern of their names without suffix, as ``glob`` takes it.
        suffix: Pattern of their suffix.
        min_age: Seconds since they were written to, at least: a writer takes its lock after it has made the file.
    """
    for stray in folder.glob(f".{stem}.{'[0-9a-f]' * 12}.tmp{suffix}"):
        with suppress(OSError):  # its writer lives, or somebody else has removed it
            if time.time() - stray.stat().st_mtime >= min_age:
                descriptor = take_lock(stray)
                shutil.rmtree(stray) if stray.is_dir() else stray.unlink(missing_ok=True)
                os.close(descriptor)


@contextmanager
def atomic_folder(path: FilePath) -> Iterator[Path]:
    """Yield a temporary folder beside a folder that does not exist yet; on success it becomes that, on failure it is removed.

    Args:
        path: The folder to write.

    Yields:
        The temporary folder, which the block fills.

    Raises:
        InputError: There is something of this name, or the folder around it is missing or cannot be written.
        PosepplError: The disk is full.
    """
    target = Path(os.path.abspath(path))
    if os.path.lexists(target):
        raise Location(path).error("the output exists", "a name that is not taken; move it away or choose another")
    _check_target(path, ())
    with _temporary(target, path) as temporary:
        temporary.mkdir()
        with _locked(temporary):
            yield temporary
            for file in temporary.rglob("*"):
                _flush(file)
            os.rename(temporary, target)  # fails where somebody has made a folder of this name and put something into it
    _note_written(path)


def _tell(error: OSError, path: FilePath) -> None:
    """Raise the error in words that a user understands, if there are some."""
    if _is_full(error):
        raise PosepplError(f"{path}: the disk is full; nothing was written (free some space, or write elsewhere)") from error
    if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS, errno.ENAMETOOLONG):
        raise Location(path).error(f"cannot be written: {error.strerror}") from error


def take_lock(path: Path) -> int:
    """Lock a file or a folder that exists.

    Args:
        path: The file or folder.

    Returns:
        A descriptor; to close it lets go.

    Raises:
        BlockingIOError: It is locked already.
        OSError: It cannot be opened, or its file system knows no locks.
    """
    descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor
