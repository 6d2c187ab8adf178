"""Reading text with a bound on its size: a file that is missing, empty, binary or absurdly large is an error that names it."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

from poseppl.errors import FilePath, Location

MAX_TEXT_BYTES = 64 * 2**20


def check_file(path: FilePath, *, max_bytes: int) -> Path:
    """Check that a path names a regular file that is neither empty nor absurdly large.

    Args:
        path: The file.
        max_bytes: The largest size that the caller reads.

    Returns:
        The path.

    Raises:
        InputError: The file is missing, not a regular file, empty, unreadable or too large.
    """
    source, at = Path(path), Location(path)
    try:
        if not source.exists():
            raise at.error("no such file", "an existing file")
        if not source.is_file():
            raise at.error("not a file", "a regular file, not a folder or a device")
        size = source.stat().st_size
    except (OSError, ValueError) as error:
        raise at.error(f"cannot be read: {error}") from error
    if size == 0:
        raise at.error("the file is empty")
    if size > max_bytes:
        raise at.error(f"the file has {size / 2**20:.0f} MiB", f"at most {max_bytes // 2**20} MiB")
    return source


def read_bytes(path: FilePath, *, max_bytes: int, first: int = -1) -> bytes:
    """Read a file, or its first so many bytes.

    Raises:
        InputError: As :func:`check_file`, or the file cannot be read.
    """
    source = check_file(path, max_bytes=max_bytes)
    try:
        with source.open("rb") as stream:
            return stream.read(first)
    except OSError as error:
        raise Location(path).error(f"cannot be read: {error.strerror}") from error


def read_text(path: FilePath, *, max_bytes: int = MAX_TEXT_BYTES) -> str:
    """Read a text file, UTF-8 or else Latin-1, as a whole.

    Args:
        path: The file.
        max_bytes: The largest size that is read.

    Returns:
        The text, without a byte-order mark, with line ends as newlines.

    Raises:
        InputError: The file cannot be read, is empty, too large, or holds binary data.
    """
    data = read_bytes(path, max_bytes=max_bytes)
    if b"\0" in data:
        raise Location(path).error("the file holds binary data", "a text file")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    # a carriage return too many, as writers of text files on Windows add it, makes no blank line
    return text.replace("\r\r\n", "\n").replace("\r\n", "\n").replace("\r", "\n")


def read_json(path: FilePath) -> Any:
    """Read a JSON file of at most 64 MiB.

    Args:
        path: The file.

    Returns:
        What it holds.

    Raises:
        InputError: The file is missing, too large or no JSON.
    """
    text = read_text(path)
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise Location(path).error(f"malformed JSON: {error}", "a whole file; it may have been cut off") from error


def read_toml(path: FilePath) -> dict[str, Any]:
    """Read a TOML file of at most 1 MiB.

    Args:
        path: The file.

    Returns:
        Its table.

    Raises:
        InputError: The file is missing, too large or no TOML.
    """
    text = read_text(path, max_bytes=2**20)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise Location(path).error(f"no TOML: {error}") from error
