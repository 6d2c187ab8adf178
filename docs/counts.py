"""Counts of the code by package: files, lines, and tokens without docstrings and comments; ``python docs/counts.py``."""

from __future__ import annotations

import ast
import tokenize
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parent.parent
_LAYOUT = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)


def docstring_lines(source: str) -> set[int]:
    """Numbers of the lines that docstrings fill."""
    lines: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and ast.get_docstring(node):
            lines.update(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    return lines


def count_tokens(path: Path) -> int:
    """Tokens of a file."""
    described = docstring_lines(path.read_text())
    with path.open("rb") as stream:
        tokens = [token for token in tokenize.tokenize(stream.readline) if token.type not in (*_LAYOUT, tokenize.ENCODING)]
    return sum(token.type != tokenize.STRING or token.start[0] not in described for token in tokens)


def main() -> None:
    """Print a row for each package, the largest first, and their sum."""
    counts: dict[str, Counter[str]] = {}
    for path in [*ROOT.glob("poseppl/**/*.py"), *ROOT.glob("models/**/*.py")]:
        parts = path.relative_to(ROOT).parts
        package = "/".join(parts[: min(len(parts) - 1, 3 if parts[1] in ("motion", "experiments") else 2)])
        found = Counter(files=1, lines=len(path.read_text().splitlines()), tokens=count_tokens(path))
        for name in (package, "sum"):
            counts[name] = counts.get(name, Counter()) + found
    for name, each in sorted(counts.items(), key=lambda item: item[1]["tokens"]):
        print(f"{name:34}{each['files']:6}{each['lines']:8}{each['tokens']:9}")


if __name__ == "__main__":
    main()
