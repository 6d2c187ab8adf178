"""Counts of the code by package: files, lines, and tokens without docstrings and comments; ``python docs/counts.py``.

``python docs/counts.py --since COMMIT`` counts the tokens of `poseppl` and `models` at a commit. It also counts today's tokens
in files that existed then, under any name, and in new files.
"""

from __future__ import annotations

import ast
import subprocess
import sys
import tokenize
from collections import Counter
from io import BytesIO
from pathlib import Path
from statistics import median

ROOT = Path(__file__).parent.parent
_FOLDERS = ("poseppl", "models", "papers")
_LAYOUT = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)


def docstring_lines(source: str) -> set[int]:
    """Numbers of the lines that docstrings fill."""
    lines: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and ast.get_docstring(node):
            lines.update(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    return lines


def count_tokens(source: str) -> int:
    """Tokens of a source."""
    described = docstring_lines(source)
    readline = BytesIO(source.encode()).readline
    tokens = [token for token in tokenize.tokenize(readline) if token.type not in (*_LAYOUT, tokenize.ENCODING)]
    return sum(token.type != tokenize.STRING or token.start[0] not in described for token in tokens)


def compare_with(commit: str) -> None:
    """Print a row for each folder: tokens of a commit, today's in the files that were there, and in others."""

    def git(*arguments: str) -> str:
        return subprocess.run(["git", *arguments], cwd=ROOT, check=True, capture_output=True, text=True).stdout

    renamed = git("diff", "--name-status", "-M40%", "-l0", "--diff-filter=R", commit, "--", *_FOLDERS)
    moved = {new: old for _, old, new in (line.split("\t") for line in renamed.splitlines())}
    before = {name for name in git("ls-tree", "-r", "--name-only", commit, *_FOLDERS).splitlines() if name.endswith(".py")}
    for folder in _FOLDERS:
        then = sum(count_tokens(git("show", f"{commit}:{name}")) for name in before if name.startswith(folder))
        counts = Counter[bool]()
        for path in ROOT.glob(f"{folder}/**/*.py"):
            name = str(path.relative_to(ROOT))
            counts[moved.get(name, name) in before] += count_tokens(path.read_text())
        print(f"{folder:10} then {then:9}  now, in the files of then {counts[True]:9}  in files since {counts[False]:9}")


def main() -> None:
    """Print a row for each package, the largest first, and their sum."""
    counts: dict[str, Counter[str]] = {}
    lengths: list[int] = []
    for path in [*ROOT.glob("poseppl/**/*.py"), *ROOT.glob("models/**/*.py"), *ROOT.glob("papers/**/*.py")]:
        parts = path.relative_to(ROOT).parts
        package = "/".join(parts[: min(len(parts) - 1, 3 if parts[1] in ("motion", "poseppl_models", "poseppl_papers") else 2)])
        source = path.read_text()
        found = Counter(files=1, lines=len(source.splitlines()), tokens=count_tokens(source))
        lengths.append(found["lines"])
        for name in (package, _wing(parts), "sum"):
            counts[name] = counts.get(name, Counter()) + found
    for name, each in sorted(counts.items(), key=lambda item: item[1]["tokens"]):
        print(f"{name:44}{each['files']:6}{each['lines']:8}{each['tokens']:9}")
    above = sum(each > 350 for each in lengths)
    print(f"lines of a file: median {median(lengths):g}, largest {max(lengths)}, {above} files above 350")


def _wing(parts: tuple[str, ...]) -> str:
    if parts[0] != "poseppl":
        return "wing: models and papers"
    return "wing: motion with cli" if parts[1] in ("motion", "cli") else "wing: toolkit"


if __name__ == "__main__":
    compare_with(sys.argv[2]) if sys.argv[1:2] == ["--since"] else main()
