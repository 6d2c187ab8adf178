"""Guides are short: no long tables, no paths of tests, and a bound on all pages beside the validation."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from website.contents import PARTS

ROOT = Path(__file__).resolve().parents[2]
GUIDES = [
    name
    for part in PARTS
    if part.heading in ("Tutorials", "How-to guides", "Concepts")
    for name in part.first
    if name.startswith("docs/")
]
MAX_ROWS, MAX_WORDS = 8, 35_000
LISTS = {"docs/opensim": 33}
"""Guides with a table that lists all of something, and its rows."""


@pytest.mark.parametrize("name", GUIDES)
def test_a_guide_has_no_long_table_and_no_path_of_a_test(name: str) -> None:
    text = (ROOT / f"{name}.md").read_text(encoding="utf-8")
    tables = re.findall(r"^(?:\|.*\n)+", text, re.MULTILINE)
    assert max((table.count("\n") - 2 for table in tables), default=0) <= LISTS.get(name, MAX_ROWS)
    assert not re.search(r"\btests/|pytest", text)


def test_pages_beside_the_validation_are_short() -> None:
    pages = [*ROOT.glob("*.md"), *(path for path in (ROOT / "docs").rglob("*.md") if path.name != "page.md")]
    words = sum(len(path.read_text(encoding="utf-8").split()) for path in pages if path.parent.name != "validation")
    assert words <= MAX_WORDS
