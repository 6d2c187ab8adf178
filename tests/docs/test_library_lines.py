"""The page's tables about other libraries: lines of programs, counted again from the files."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from benchmarks.peers.__main__ import HERE, count_lines

PAGE = Path(__file__).resolve().parents[2] / "docs" / "validation" / "libraries.md"


def written() -> set[tuple[str, str, int]]:
    """Library, method and lines of each row."""
    rows = re.findall(
        r"^\|(?: \w+ \|)? ([\w-]+) [\d.]+ \| ([^|]+) \| (\d+) \| [\d. ]", PAGE.read_text(encoding="utf-8"), re.MULTILINE
    )
    return {(library, method, int(lines)) for library, method, lines in rows}


def counted() -> set[tuple[str, str, int]]:
    """The same, of each library's file."""
    found = set()
    for path in HERE.glob("with_*.py"):
        for line in path.read_text(encoding="utf-8").splitlines():
            if line.startswith("NAME, PACKAGE, METHOD"):
                name, _, method, *_ = ast.literal_eval(line.partition(" = ")[2])
                found.add((name, method, count_lines(path)))
    return found


def test_lines_of_the_tables_are_those_of_the_files():
    assert len(written()) > 18
    assert not written() - counted()
