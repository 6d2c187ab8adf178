"""Algorithms at a glance: what one is for, its cost, when it fails, the laws that it is held to, its settings.

What it is for, its cost and its failures are the rows of `docs/choosing.md`, settings those that `poseppl filters` lists, laws
the rows of `tests/catalogue.py`.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from poseppl.runs.algorithms import FILTERS, SMOOTHERS, Algorithm
from website.markup import plain

ROOT = Path(__file__).resolve().parents[2]
LAWS = {
    "consistent": "means and variances converge to the exact ones",
    "unbiased_evidence": "its evidence is unbiased",
    "genealogy": "particles descend from the ancestors that it names",
}


def algorithms() -> list[Algorithm]:
    """All filters, then all smoothers."""
    return [*FILTERS.values(), *SMOOTHERS.values()]


def index() -> str:
    """The page that lists them."""
    lines = ["Algorithms", "==========", ""]
    lines += ["Equation, cost, laws, failures and settings of each; :doc:`docs/choosing` compares them.", ""]
    for title, mapping in (("Filters", FILTERS), ("Smoothers", SMOOTHERS)):
        lines += [title, "-" * len(title), "", ".. list-table::", "   :widths: 25 75", ""]
        for each in mapping.values():
            lines += [f"   * - :doc:`{each.name} <reference/{_module(each)}>`", f"     - {plain(each.summary)}"]
        lines += [""]
    return "\n".join(lines)


def glance(module: str) -> list[str]:
    """Lines on the algorithm that a module holds; none if it holds none."""
    lines: list[str] = []
    for each in of_module(module):
        lines += [*_choice(module), *_laws(each), *_settings(each)]
    return lines


def of_module(module: str) -> list[Algorithm]:
    """The algorithms that a module holds."""
    return [each for each in algorithms() if _module(each) == module]


def title(module: str) -> str:
    """The title of a module's page: an algorithm's own name, else the module's."""
    found = of_module(module)
    return f"{found[0].name} {found[0].kind}" if len(found) == 1 else module


def _module(algorithm: Algorithm) -> str:
    return str(algorithm.builder.__module__)


def _choice(module: str) -> list[str]:
    lines: list[str] = []
    for cells in _rows().get(module, []):
        if lines:
            lines.append("")
        lines += [f":{head}: {plain_links(cell)}" for head, cell in list(cells.items())[2:] if cell]
    return [".. rubric:: At a glance", "", *lines, ""] if lines else []


@cache
def _rows() -> dict[str, list[dict[str, str]]]:
    """Rows of the tables in `docs/choosing.md` by the modules that they link to."""
    found: dict[str, list[dict[str, str]]] = {}
    head: list[str] = []
    for line in (ROOT / "docs" / "choosing.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if not line.startswith("|"):
            head = []
        elif not head:
            head = cells
        elif not set(line) <= set("|- "):
            for path in re.findall(r"\(\.\./([\w/]+)\.py\)", cells[0]):
                found.setdefault(path.replace("/", "."), []).append(dict(zip(head, cells, strict=True)))
    return found


def plain_links(text: str) -> str:
    """A line of Markdown in reStructuredText: links to pages stay such, others become text."""

    def link(match: re.Match[str]) -> str:
        words, page = match[1], match[2].partition("#")[0]
        if page.startswith("../poseppl/"):
            return f":doc:`{words} </reference/{page[3:-3].replace('/', '.')}>`"
        if page.startswith("../notebooks/"):
            return f":doc:`{words} </{page[3:-3]}>`"
        return f":doc:`{words} </docs/{page.removesuffix('.md')}>`" if page.endswith(".md") else words

    return plain(re.sub(r"\[([^\]]*)\]\(([^)]*)\)", link, text))


def _laws(algorithm: Algorithm) -> list[str]:
    rows = [row for row in _catalogue() if getattr(row.function, "__wrapped__", row.function) is _bare(algorithm)]
    if not rows:
        return []
    held = [words for flag, words in LAWS.items() if any(getattr(row, flag, False) for row in rows)]
    names = ", ".join(f"`{row.name}`" for row in rows)
    return [f":laws: those of `tests/laws`, as {names}{': ' if held else ''}{'; '.join(held)}", ""]


def _bare(algorithm: Algorithm) -> Any:
    return getattr(algorithm.builder, "__wrapped__", algorithm.builder)


@cache
def _catalogue() -> tuple[Any, ...]:
    sys.path.append(str(ROOT / "tests"))
    import catalogue

    return (*catalogue.FILTERS, *catalogue.SMOOTHERS)


def _settings(algorithm: Algorithm) -> Iterator[str]:
    command = {"filter": "poseppl track --filter", "smoother": "poseppl smooth RESULT --method"}[algorithm.kind]
    yield from (".. rubric:: Settings", "", f"On the command line: `{command} {algorithm.name}`.", "")
    if algorithm.settings:
        yield from (".. list-table::", "   :header-rows: 1", "   :widths: 20 15 15 50", "")
        yield from ("   * - setting", "     - type", "     - default", "     - what it is")
    for setting in algorithm.settings.values():
        yield from (f"   * - `{setting.name}`", f"     - {setting.type_name.replace('|', ', ')}")
        yield from (f"     - {setting.shown.rpartition(' = ')[2]}", f"     - {plain(setting.text)}")
    yield ""
