"""Find prose that is hard to read: python docs/prose.py [FILE ...]; without files, that of PAGES and SOURCES.

Pages and notebooks are read as a whole, modules by their docstrings and comments. It reports words that have a plainer or a
more usual one, sentences that do not begin with their subject, and sentences of more than 30 words. Code and tables are left
out. The status is the number of findings, at most 100.
"""

from __future__ import annotations

import ast
import inspect
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGES = (
    *("README.md", "CONTRIBUTING.md", "CHANGELOG.md"),
    *sorted(str(path.relative_to(ROOT)) for path in (ROOT / "docs").rglob("*.md") if path.name != "page.md"),
    *sorted(str(path.relative_to(ROOT)) for path in (ROOT / "notebooks").glob("*.py")),
)
"""All pages but those of papers, which their own tables make, and all notebooks."""
FOLDERS = ("poseppl", "models", "papers", "studies", "benchmarks", "docs")
SOURCES = tuple(str(path.relative_to(ROOT)) for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py")))
LONGEST = 30
WORDS = {
    r"told|tells (?:of|the user)": "reported, warned, printed",
    r"mend(?:s|ed|ing)?": "correct, fix",
    r"foretold|foretells?": "predicted",
    r"intervals? (?:that )?holds?|holds? \d+ %": "the coverage of ... is",
    r"anew": "again",
    r"of ours": "our",
    r"a root of a second": "the square root of the time",
    r"nothing to complain of": "no problems detected",
    r"for who|who is told": "if you",
    r"as it is": "unchanged",
    r"the former|the latter": "name it",
    r"lasting errors|errors that last": "autocorrelated errors",
    r"too sure": "overconfident",
    r"house|wings? of": "package",
}
FRONTED = re.compile(r"[*_ -]*(Of|What|Where|Who|Whoever) (?!.*\?[*_]*$)")
"""Sentences that begin with what should follow; questions may."""
HEADING = re.compile(r"[A-Z]\w+:")
ENTRY = re.compile(r"^(\w+(\.\w+)*|[a-z_*]+(, [a-z_*]+)+): ")
"""An argument, attribute or exception in a docstring."""


def markdown_of(script: str) -> str:
    """The text cells of a notebook in the py:percent form, on the lines where they are; other lines are empty."""
    lines, is_text = list[str](), False
    for line in script.splitlines():
        is_cell = line.startswith("# %%")
        is_text = "[markdown]" in line if is_cell else is_text
        lines.append(line[2:] if is_text and not is_cell else "")
    return "\n".join(lines)


def prose_of(module: str) -> str:
    """The docstrings and comments of a module, on the lines where they are; other lines are empty.

    Entries of arguments and comments beside code become list items. Examples, formulas, tables and headings are left out.
    """
    lines = [""] * (module.count("\n") + 2)
    for node in ast.walk(ast.parse(module)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            before, is_code = "text", False
            for number, line in enumerate(inspect.cleandoc(node.value.value).splitlines(), start=node.lineno - 1):
                begins = line.lstrip().startswith((">>>", "==")) or (line.startswith("    ") and not before)
                before, is_code = line.strip(), bool(line.strip()) and (is_code or begins)
                if not is_code and not HEADING.fullmatch(line):
                    lines[number] = ENTRY.sub("* ", before)
    for token in tokenize.generate_tokens(io.StringIO(module).readline):
        if token.type == tokenize.COMMENT:
            is_beside = token.line[: token.start[1]].strip()
            lines[token.start[0] - 1] = ("* " if is_beside else "") + token.string.lstrip("# ")
    return "\n".join(lines)


def text_of(name: str) -> str:
    """The text of a file that people read."""
    content = (ROOT / name).read_text(encoding="utf-8")
    if not name.endswith(".py"):
        return content
    return markdown_of(content) if name.startswith("notebooks/") else prose_of(content)


def paragraphs(text: str) -> Iterator[tuple[int, str]]:
    """Paragraphs of prose with the number of their first line, list items on their own."""
    fenced, start, lines = False, 0, list[str]()
    for number, line in enumerate([*text.splitlines(), ""], start=1):
        if line.startswith("```"):
            fenced = not fenced
        prose = not (fenced or line.startswith(("```", "#", "|", "    ", "<!--", "![", ">>>")) or not line.strip())
        begins = bool(re.match(r"\s*(?:[*-]|\d+\.) ", line))
        if lines and (not prose or begins):
            yield start, " ".join(lines)
            lines = []
        if prose:
            start = start if lines else number
            lines.append(line.strip())


def findings(text: str) -> Iterator[tuple[int, str]]:
    """Line numbers and what is wrong there."""
    for number, paragraph in paragraphs(text):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", re.sub(r"`[^`]*`", "Code", paragraph))
        plain = re.sub(r"\([^)]*\)", "", plain)
        for pattern, better in WORDS.items():
            for match in re.finditer(rf"\b(?:{pattern})\b", plain, re.IGNORECASE):
                yield number, f"{match[0]!r}: write {better}"
        for sentence in re.split(r"(?<=[.!?:;])[\"')]*\s+", plain):
            if FRONTED.match(sentence):
                yield number, f"subject first: {sentence[:60]} ..."
            words = len(re.findall(r"[A-Za-z][\w'-]*", sentence))
            if words > LONGEST:
                yield number, f"a sentence of {words} words: {sentence[:60]} ..."


def main() -> int:
    """Print the findings of the files that are named."""
    count = 0
    for name in sys.argv[1:] or (*PAGES, *SOURCES):
        for number, problem in findings(text_of(name)):
            print(f"{name}:{number}: {problem}")
            count += 1
    return min(count, 100)


if __name__ == "__main__":
    sys.exit(main())
