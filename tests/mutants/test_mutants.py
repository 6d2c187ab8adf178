"""The mutants themselves: headers that can be read, patches that apply, tests that exist. `run.py` beside it runs them."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest
from mutant import ROOT, apply, copy_tree, read_mutants

MUTANTS = read_mutants()


@cache
def functions_of(path):
    """Names of the test functions of a file."""
    return {node.name for node in ast.walk(ast.parse((ROOT / path).read_text())) if isinstance(node, ast.FunctionDef)}


def test_there_are_enough_in_every_package():
    changed = [re.search(r"^\+\+\+ b/(\S+)", mutant.patch.read_text(), re.MULTILINE)[1] for mutant in MUTANTS]
    assert len(MUTANTS) >= 100
    packages = {str(path.parent.relative_to(ROOT)) for path in (ROOT / "poseppl").rglob("__init__.py")}
    assert packages <= {str(parent) for path in changed for parent in Path(path).parents}
    assert any(path.startswith("models/") for path in changed)


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_the_named_tests_exist(mutant):
    for test in mutant.tests:
        path, _, name = test.partition("::")
        assert name.partition("[")[0] in functions_of(path), test


def test_every_patch_applies(tmp_path):
    copy = copy_tree(tmp_path)
    problems = {mutant.name: problem for mutant in MUTANTS if (problem := apply(mutant, copy, check=True))}
    assert not problems, f"changed sources under a mutant: change its patch as well. {problems}"
