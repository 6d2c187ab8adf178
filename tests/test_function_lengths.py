"""Functions are short: none above eighty lines, its docstring counted."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LONGEST = 80


def lengths(source: str) -> dict[str, int]:
    """Lines of each function by its name, the decorators left out."""
    functions = (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))
    return {node.name: (node.end_lineno or node.lineno) - node.lineno + 1 for node in functions}


@pytest.mark.parametrize("package", ["poseppl", "models", "papers"])
def test_no_function_is_long(package: str) -> None:
    files = sorted((ROOT / package).rglob("*.py"))
    long = {f"{path.relative_to(ROOT)}: {name}": count for path in files for name, count in lengths(path.read_text()).items()}
    assert long and {name: count for name, count in long.items() if count > LONGEST} == {}


def test_one_that_is_too_long_is_counted() -> None:
    assert lengths("def short():\n    pass\n\n\ndef long():\n" + LONGEST * "    pass\n") == {"short": 2, "long": LONGEST + 1}
