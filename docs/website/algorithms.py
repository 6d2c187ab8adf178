"""Algorithms at a glance, on the pages of their modules: what each computes, its cost, needs, failures and settings.

The fields are those of its section in `docs/algorithms.md`, settings those that `poseppl filters` lists.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from poseppl.runs.algorithms import FILTERS, SMOOTHERS, Algorithm
from website.markup import plain

PAGE = Path(__file__).resolve().parents[1] / "algorithms.md"
_FIELD = re.compile(r"^\* \*\*(\w+):\*\* (.*(?:\n {2}.*)*)", re.MULTILINE)


def algorithms() -> list[Algorithm]:
    """All filters, then all smoothers."""
    return [*FILTERS.values(), *SMOOTHERS.values()]


def glance(module: str) -> list[str]:
    """Lines on the algorithm that a module defines; none if it defines none."""
    lines: list[str] = []
    for each in of_module(module):
        lines += [*_at_a_glance(module), *_settings(each)]
    return lines


def of_module(module: str) -> list[Algorithm]:
    """The algorithms that a module defines."""
    return [each for each in algorithms() if _module(each) == module]


def title(module: str) -> str:
    """The title of a module's page: an algorithm's own name, else the module's."""
    found = of_module(module)
    return f"{found[0].name} {found[0].kind}" if len(found) == 1 else module


def fields_of(module: str) -> dict[str, str]:
    """The fields of a module's section in `docs/algorithms.md`, by name; empty without a section."""
    path = f"(../{module.replace('.', '/')}.py)"
    section = next((each for each in _sections() if path in each), "")
    return {name: " ".join(text.split()) for name, text in _FIELD.findall(section)}


@cache
def _sections() -> list[str]:
    return re.split(r"^#+ ", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)


def _module(algorithm: Algorithm) -> str:
    return str(algorithm.builder.__module__)


def _at_a_glance(module: str) -> list[str]:
    fields = [f":{name.lower()}: {plain_links(text)}" for name, text in fields_of(module).items()]
    return [".. rubric:: At a glance", "", *fields, ""] if fields else []


def plain_links(text: str) -> str:
    """A line of Markdown in reStructuredText: links to pages stay such, others become text."""

    def link(match: re.Match[str]) -> str:
        words, page = match[1], match[2].partition("#")[0]
        if page.startswith("../poseppl/"):
            return f":doc:`{words} </reference/{page[3:-3].replace('/', '.')}>`"
        return f":doc:`{words} </docs/{page.removesuffix('.md')}>`" if page.endswith(".md") else words

    return plain(re.sub(r"\[([^\]]*)\]\(([^)]*)\)", link, text))


def _settings(algorithm: Algorithm) -> Iterator[str]:
    command = {"filter": "poseppl track --filter", "smoother": "poseppl smooth RESULT --method"}[algorithm.kind]
    yield from (".. rubric:: Settings", "", f"On the command line: `{command} {algorithm.name}`.", "")
    for setting in algorithm.settings.values():
        default = setting.shown.rpartition(" = ")[2]
        yield f":{setting.name}: {plain(setting.text)} (`{setting.type_name.replace('|', ', ')}`; default `{default}`)"
    yield ""
