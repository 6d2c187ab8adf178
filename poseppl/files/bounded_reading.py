"""Reading text with a bound on its size: a file that is missing, empty, binary or absurdly large is an error that names it.

Bounded besides is what a small text makes a parser do: lines, values of JSON, elements of XML, parts of a key of TOML.
"""

from __future__ import annotations

import codecs
import json
import re
import tomllib
import xml.etree.ElementTree as ElementTree
import xml.parsers.expat as expat
from pathlib import Path
from typing import Any

from poseppl.errors import FilePath, Location, cut

MAX_TEXT_BYTES = 64 * 2**20
MAX_LINES = 10_000_000
MAX_JSON_LISTS = 2_000_000
"""Lists and objects in a JSON file."""
MAX_XML_BYTES = 2**22
MAX_XML_ELEMENTS = 100_000
MAX_KEY_PARTS = 20
_LONG_KEY = re.compile(r"""(?:\.[ \t]*+(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+){20}""")


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
    """Read a text file as a whole: UTF-16 if a byte-order mark says so, else UTF-8 or else Latin-1.

    Args:
        path: The file.
        max_bytes: The largest size that is read.

    Returns:
        The text, without a byte-order mark, with line ends as newlines.

    Raises:
        InputError: The file cannot be read, is empty, too large, has too many lines, or contains binary data.
    """
    text = _decoded(read_bytes(path, max_bytes=max_bytes))
    if "\0" in text:
        raise Location(path).error("the file contains binary data", "a text file")
    # a carriage return too many, as writers of text files on Windows add it, makes no blank line
    text = text.replace("\r\r\n", "\n").replace("\r\n", "\n").replace("\r", "\n")
    if text.count("\n") > MAX_LINES:
        raise Location(path).error(f"more than {MAX_LINES} lines", "fewer; most of them may be blank")
    return text


def _decoded(data: bytes) -> str:
    wide = data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    try:
        return data.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def read_json(path: FilePath) -> Any:
    """Read a JSON file of at most 64 MiB.

    Args:
        path: The file.

    Returns:
        Its content.

    Raises:
        InputError: The file is missing, too large, has too many lists, or is no JSON.
    """
    text, at = read_text(path), Location(path)
    if text.count("[") + text.count("{") > MAX_JSON_LISTS:
        raise at.error(f"more than {MAX_JSON_LISTS} lists and objects", "fewer; a recording can be read in parts")
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise at.error(f"malformed JSON: {error}", "a whole file; it may have been cut off") from error


def read_xml(path: FilePath, expected: str) -> ElementTree.Element:
    """Read an XML file of at most 4 MiB. XML could refer to other files and repeat itself: definitions are refused.

    Args:
        path: The file.
        expected: The expected content, for messages.

    Returns:
        Its root. Names keep the prefixes of their namespaces: with those written out, a file could grow without end.

    Raises:
        InputError: The file is missing, too large, no XML, defines entities, or has too many elements or levels.
    """
    text, at = read_text(path, max_bytes=MAX_XML_BYTES), Location(path)
    if text.count("<") > 2 * MAX_XML_ELEMENTS or text.count("=") > 4 * MAX_XML_ELEMENTS:
        raise at.error("too many elements or attributes", f"at most {MAX_XML_ELEMENTS}")

    def refuse(*_: object) -> None:
        raise at.error("the XML has definitions of its own", expected)

    parser, builder = expat.ParserCreate("utf-8"), ElementTree.TreeBuilder()
    parser.buffer_text = True
    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(text, True)
        return builder.close()
    except (expat.ExpatError, ValueError) as error:
        raise at.error(f"no XML: {cut(error, 100)}", f"{expected}; it may have been cut off") from error


def read_toml(path: FilePath) -> dict[str, Any]:
    """Read a TOML file of at most 1 MiB.

    Args:
        path: The file.

    Returns:
        Its table.

    Raises:
        InputError: The file is missing, too large or no TOML.
    """
    text, at = read_text(path, max_bytes=2**20), Location(path)
    long = _LONG_KEY.search(text)
    if long:
        raise at.in_line(text.count("\n", 0, long.start()) + 1).error(
            "a key or a text of too many parts", f"at most {MAX_KEY_PARTS} parts, with dots between"
        )
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise at.error(f"no TOML: {error}") from error
