"""The mutants themselves: tables that can be read, replacements that apply, tests that exist. `run.py` beside it runs them."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest
from mutant import ROOT, Mutant, import_paths, mutated, read_mutants

MUTANTS = read_mutants()
SOURCE = "def gain(a, b):\n    return (a\n        + b) / b\n\n\nclass Filter:\n    def gain(self):\n        return 1\n"


@cache
def functions_of(path: str) -> set[str]:
    """Names of the test functions of a file."""
    return {node.name for node in ast.walk(ast.parse((ROOT / path).read_text())) if isinstance(node, ast.FunctionDef)}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Sources of one module."""
    path = tmp_path / "poseppl" / "filters" / "kalman.py"
    path.parent.mkdir(parents=True)
    path.write_text(SOURCE)
    return tmp_path


def gain(function: str, replace: str, module: str = "poseppl.filters.kalman") -> Mutant:
    return Mutant("gain", "wrong", module, function, replace, "a - b")


def test_every_mutated_package_is_imported_from_the_copy() -> None:
    """Else the tests would see the unchanged package, and notice nothing."""
    packages = {mutant.module.partition(".")[0] for mutant in MUTANTS}
    assert all(any((Path(path) / package).is_dir() for path in import_paths(ROOT)) for package in packages)


def test_there_are_enough_in_every_package() -> None:
    packages = {".".join(path.parent.relative_to(ROOT).parts) for path in (ROOT / "poseppl").rglob("__init__.py")}
    packages -= {"poseppl.motion", "poseppl"}
    assert len(MUTANTS) >= 100
    assert packages <= {mutant.module.rsplit(".", depth)[0] for mutant in MUTANTS for depth in (0, 1, 2)}
    assert any(mutant.module.startswith("poseppl_models.") for mutant in MUTANTS)


def test_the_named_tests_exist() -> None:
    for mutant in MUTANTS:
        for test in mutant.tests:
            path, _, name = test.partition("::")
            assert name.partition("[")[0] in functions_of(path), f"{mutant.name}: {test}"


def test_every_mutant_applies() -> None:
    for mutant in MUTANTS:
        path, changed = mutated(mutant, ROOT)
        assert changed.split() != path.read_text().split(), mutant.name


def test_an_expression_is_found_by_its_text_alone(folder: Path) -> None:
    assert mutated(gain("gain", "(a + b) / b"), folder)[1] == SOURCE.replace("(a\n        + b) / b", "a - b")


def test_a_function_is_found_where_it_has_moved_to(folder: Path) -> None:
    path, changed = mutated(gain("Filter.gain", "1", "poseppl.filters.old"), folder)
    assert path.name == "kalman.py" and changed == SOURCE.replace("return 1", "return a - b")


@pytest.mark.full
@pytest.mark.parametrize(("function", "replace"), [("gain", "b"), ("gain", "a - b"), ("other", "a + b")])
def test_what_is_not_there_once_is_refused(folder: Path, function: str, replace: str) -> None:
    with pytest.raises(ValueError, match="stands [0-9] times in"):
        mutated(gain(function, replace), folder)
