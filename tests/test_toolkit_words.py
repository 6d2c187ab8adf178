"""The toolkit knows no body: its code and pages use no words of one, but for what is listed here and may only become less."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import poseppl

ROOT = Path(poseppl.__file__).parent
PACKAGES = ("program", "particles", "gaussians", "kernels", "filters", "smoothers", "runs", "diagnostics", "report", "jobs")
WORDS = re.compile(
    "body|bodies|skeletons?|silhouettes?|keypoints?|stature|pelvis|hips|limbs?|cameras?|markers|joints?|person|overlays?|poses?|flesh"
)
LEFT = {
    "diagnostics/comparison.py": {"camera", "cameras", "joint"},
    "diagnostics/diagnosis.py": {"body"},
    "diagnostics/paired_comparison.py": {"joint"},
    "diagnostics/run_figures.py": {"joint", "joints", "silhouettes"},
    "diagnostics/verdicts/comparison.py": {"cameras"},
    "report/compare.py": {"joint"},
    "report/compare_tables.py": {"joint"},
}
"""Words that remain, by file: errors and coverage of markers, and cameras of compared runs."""
OTHER_MEANINGS = {
    "joint": ("program", "smoothers", "runs", "filters", "kernels", "gaussians", "particles"),
    "markers": ("report",),
}
"""A joint density is no joint of a body, and Plotly calls its dots markers."""


def written(tree: ast.AST) -> Iterator[str]:
    """Names and texts of a module's code, not its docstrings."""
    bodies = [node.body for node in ast.walk(tree) if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)]
    docstrings = {id(each.value) for body in bodies for each in body if isinstance(each, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings:
            yield node.value
        for field in ("id", "attr", "arg", "name"):
            yield str(getattr(node, field, "") or "")


def words_of(path: Path) -> set[str]:
    found = {
        word for text in written(ast.parse(path.read_text(encoding="utf-8"))) for word in re.findall("[a-z]+", text.lower())
    }
    package = path.relative_to(ROOT).parts[0]
    return {word for word in found if WORDS.fullmatch(word) and package not in OTHER_MEANINGS.get(word, ())}


def test_the_toolkit_uses_no_words_of_a_body() -> None:
    found = {str(path.relative_to(ROOT)): words_of(path) for name in PACKAGES for path in (ROOT / name).rglob("*.py")}
    assert {name: words for name, words in found.items() if words} == LEFT


def test_pages_of_the_toolkit_use_no_words_of_a_body() -> None:
    pages = [*(ROOT / "report" / "templates").glob("*.html"), *(ROOT / "report" / "templates").glob("*.js")]
    texts = {path.name: re.findall("[a-z]+", path.read_text(encoding="utf-8").lower()) for path in pages}
    assert {name: {word for word in words if WORDS.fullmatch(word)} - {"body"} for name, words in texts.items()} == {
        name: {"joint"} if name == "comparison.html" else {"flesh"} if name == "page.js" else set() for name in texts
    }
