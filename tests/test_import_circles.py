"""No module imports itself by way of others, not even where a type is checked or a function runs."""

from __future__ import annotations

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import poseppl_models
import poseppl_papers
import pytest

import poseppl


def sources() -> dict[str, str]:
    """The text of each module."""
    found = {}
    for package in (poseppl, poseppl_models, poseppl_papers):
        folder = Path(*package.__path__)
        for path in folder.rglob("*.py"):
            name = ".".join(path.relative_to(folder.parent).with_suffix("").parts)
            found[name.removesuffix(".__init__")] = path.read_text(encoding="utf-8")
    return found


def packages_of(name: str) -> set[str]:
    """The packages that a module is in."""
    parts = name.split(".")
    return {".".join(parts[:end]) for end in range(1, len(parts))}


def imports_of(name: str, modules: dict[str, str]) -> set[str]:
    """The modules that a module imports, wherever in it, and the packages that this loads first.

    A name from a package is its module where there is one.
    """
    found = set()
    for node in ast.walk(ast.parse(modules[name])):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            members = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {member if member in modules else node.module for member in members}
    loaded = set().union(*map(packages_of, found)) - packages_of(name) - {name}
    return (found | loaded) & modules.keys()


def circle(modules: dict[str, str]) -> list[str]:
    """Modules that import each other in turn; none where there is no circle."""
    try:
        TopologicalSorter({name: imports_of(name, modules) for name in modules}).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_no_modules_import_each_other_in_a_circle() -> None:
    modules = sources()
    assert len(modules) > 500 and circle(modules) == []


@pytest.mark.parametrize(
    "text",
    [
        "import p.a",
        "from p import a",
        "from p.a import f",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from p.a import f",
        "def f():\n    from p import a",
    ],
)
def test_a_circle_is_found_however_it_is_hidden(text: str) -> None:
    modules = {"p": "", "p.a": "from p.b import g", "p.b": text, "p.c": "import p.a"}
    assert set(circle(modules)) == {"p.a", "p.b"}
    assert circle(modules | {"p.b": "import p"}) == []


def test_a_circle_by_way_of_a_package_is_found() -> None:
    modules = {"p": "", "p.q": "from p.q.a import f", "p.q.a": "from p.r import g", "p.r": "from p.q.b import h", "p.q.b": ""}
    assert set(circle(modules)) == {"p.q", "p.q.a", "p.r"}
    assert circle(modules | {"p.q": ""}) == []
