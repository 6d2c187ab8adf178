"""Folders of scripts that tests put on one path: of two modules with one name, one would be hidden."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import pytest

pytestmark = pytest.mark.full

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("tests", "tests/laws", ".", "docs")


def modules(folder: Path) -> set[str]:
    """Modules and packages that a folder of the path gives."""
    return {path.stem for path in folder.glob("*.py")} | {path.parent.name for path in folder.glob("*/__init__.py")}


def test_no_module_hides_another() -> None:
    found = {folder: modules(ROOT / folder) for folder in FOLDERS}
    assert all(found.values())
    shared = {(one, other): found[one] & found[other] for one, other in combinations(FOLDERS, 2)}
    assert {folders: names for folders, names in shared.items() if names} == {}
