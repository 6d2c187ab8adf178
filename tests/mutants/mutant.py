"""Mutants: one-line mistakes that an expert could make, each with the tests that must notice it.

A mutant names a module, a function in it, and an expression or a statement of that function that another one replaces. Line
numbers, line breaks and a move of the function to another module do not matter. The `.toml` files beside this one have a table
for each mutant:

    [filters-kalman-first]
    wrong = "what is wrong, in words"
    module = "poseppl.filters.kalman"
    function = "update.again"                  # nested functions and methods by dots; empty for the module itself
    replace = "an expression"                  # stands once in the function; spaces and line breaks are ignored
    by = "another one"
    tests = ["tests/filters/test_kalman.py::test_name"]      # one of them must fail; the cheapest come first
    reason = "in place of tests: why no test of behaviour can notice it"
"""

from __future__ import annotations

import ast
import shutil
import tomllib
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[2]
TABLES = Path(__file__).parent
_SOURCES = {"poseppl": "poseppl", "poseppl_models": "models/poseppl_models", "poseppl_papers": "papers/poseppl_papers"}
_PARTS = (
    "poseppl",
    "models",
    "papers",
    "tests",
    "benchmarks",
    "studies",
    "docs",
    "notebooks",
    ".ci",
    "pyproject.toml",
    "README.md",
    "CHANGELOG.md",
)
_Scope = ast.Module | ast.FunctionDef | ast.ClassDef


class Mutant(NamedTuple):
    """One mistake.

    Attributes:
        name: Unique.
        wrong: Description of the mistake.
        module: Module of the function; if the function has moved, all modules are searched.
        function: Its qualified name.
        replace: An expression or a statement of the function.
        by: Its replacement.
        tests: Ids of the tests, one of which must fail; none where there is a reason.
        reason: Why none can.
    """

    name: str
    wrong: str
    module: str
    function: str
    replace: str
    by: str
    tests: tuple[str, ...] = ()
    reason: str = ""


def import_paths(folder: Path) -> list[str]:
    """Import paths of the packages of a copy of the repository."""
    return list(dict.fromkeys(str((folder / source).parent) for source in _SOURCES.values()))


def read_mutants(names: Sequence[str] = ()) -> list[Mutant]:
    """All mutants by name, or those named.

    Raises:
        ValueError: A table with other fields than a mutant's, a name that stands twice, or an unknown name.
    """
    mutants: dict[str, Mutant] = {}
    for path in sorted(TABLES.glob("*.toml")):
        for name, table in tomllib.loads(path.read_text(encoding="utf-8")).items():
            if name in mutants:
                raise ValueError(f"{path.name}: {name} stands twice")
            mutants[name] = _mutant(path.name, name, table)
    unknown = sorted(set(names) - set(mutants))
    if unknown:
        raise ValueError(f"no mutant is called {', '.join(unknown)}; their names are in {TABLES}/*.toml")
    return [mutants[name] for name in sorted(mutants) if not names or name in names]


def _mutant(file: str, name: str, table: dict[str, object]) -> Mutant:
    needed = {"wrong", "module", "function", "replace", "by"}
    one_of = {"tests", "reason"} & set(table)
    if set(table) != needed | one_of or len(one_of) != 1:
        expected = f"{', '.join(sorted(needed))}, and tests or reason"
        raise ValueError(f"{file}: {name} has the fields {', '.join(table)}. Expected {expected}")
    fields: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in table.items()}
    return Mutant(name, **fields)


def copy_tree(folder: Path) -> Path:
    """Copy the sources into a folder, in which mutants can be applied."""
    for part in _PARTS:
        source, target = ROOT / part, folder / part
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("*.egg-info", "__pycache__"))
        elif source.is_file():
            shutil.copy2(source, target)
    return folder


def apply(mutant: Mutant, folder: Path) -> None:
    """Apply a mutant to a copy of the sources.

    Raises:
        ValueError: No function, or more than one, has what is to be replaced, or not once.
    """
    path, source = mutated(mutant, folder)
    path.write_text(source, encoding="utf-8")


def mutated(mutant: Mutant, folder: Path) -> tuple[Path, str]:
    """The file of a mutant in a folder, and what it holds with the mistake; `ValueError` as for :func:`apply`."""
    own = _path_of(mutant.module, folder)
    places = _places(mutant, own) if own.is_file() else []
    if not places:
        everywhere = (path for part in _SOURCES.values() for path in sorted((folder / part).rglob("*.py")))
        places = [place for path in everywhere for place in _places(mutant, path)]
    if len(places) != 1:
        where = f"{mutant.function or 'the body'} of {mutant.module}"
        raise ValueError(f"{mutant.name}: {mutant.replace!r} stands {len(places)} times in {where}")
    path, source, start, end = places[0]
    column = start - source.rfind("\n", 0, start) - 1
    by = mutant.by.strip("\n").replace("\n", "\n" + " " * column)
    changed = source[:start] + by + source[end:]
    compile(changed, str(path), "exec")
    return path, changed


def _path_of(module: str, folder: Path) -> Path:
    package, _, rest = module.partition(".")
    path = folder / _SOURCES[package] / rest.replace(".", "/") if rest else folder / _SOURCES[package]
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def _places(mutant: Mutant, path: Path) -> list[tuple[Path, str, int, int]]:
    """Find the code to replace in a file's function of that name: the file, its text, and the first and last character."""
    source = path.read_text(encoding="utf-8")
    name, wanted = mutant.function.rpartition(".")[2], _squeezed(mutant.replace)
    if f"def {name}" not in source and f"class {name}" not in source and name:
        return []
    offsets = _line_starts(source)
    spans = {
        (_offset(source, offsets, node.lineno, node.col_offset), _offset(source, offsets, node.end_lineno, node.end_col_offset))
        for scope_name, scope in _scopes(source)
        if scope_name == mutant.function
        for node in _parts_of(scope)
        if node.end_lineno is not None and node.end_col_offset is not None
    }
    return [(path, source, start, end) for start, end in sorted(spans) if _squeezed(source[start:end]) == wanted]


@cache
def _scopes(source: str) -> list[tuple[str, _Scope]]:
    """The module, and all functions and classes by qualified name."""
    tree = ast.parse(source)
    waiting: list[tuple[tuple[str, ...], ast.AST]] = [((), tree)]
    found: list[tuple[str, _Scope]] = [("", tree)]
    while waiting:
        names, node = waiting.pop()
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef | ast.ClassDef):
                found.append((".".join((*names, child.name)), child))
                waiting.append(((*names, child.name), child))
            elif not isinstance(child, ast.expr):
                waiting.append((names, child))
    return found


def _parts_of(scope: _Scope) -> Iterator[ast.stmt | ast.expr | ast.arg | ast.keyword]:
    return (node for node in ast.walk(scope) if isinstance(node, ast.stmt | ast.expr | ast.arg | ast.keyword))


def _line_starts(source: str) -> list[int]:
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    return starts


def _offset(source: str, starts: list[int], line: int, column: int) -> int:
    """The character at a line and a column, which `ast` counts in bytes of UTF-8."""
    start = starts[line - 1]
    text = source[start : starts[line]]
    return start + (column if text.isascii() else len(text.encode()[:column].decode()))


def _squeezed(text: str) -> str:
    return "".join(text.split())
