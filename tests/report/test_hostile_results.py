"""A result may come from anybody: whatever its texts are, the pages are built of the same elements."""

from __future__ import annotations

from html.parser import HTMLParser

import pytest
from hostile import HOSTILE, telling

from poseppl.diagnostics import compare
from poseppl.report import comparison_html, page, report_html

pytestmark = pytest.mark.full

HARMLESS = tuple(f"name {number} " for number in range(len(HOSTILE)))


class Elements(HTMLParser):
    """Tags and names of attributes, in their order."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[str, ...]] = []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, *(name for name, _ in attributes)))

    def handle_comment(self, data: str) -> None:
        self.found.append(("comment", data))


def elements(page: str) -> list[tuple[str, ...]]:
    parser = Elements()
    parser.feed(page)
    parser.close()
    return parser.found


def compared(texts: tuple[str, ...]) -> str:
    return comparison_html(compare({texts[0]: telling(texts), texts[1]: telling(texts)}))


@pytest.mark.parametrize("made", [lambda texts: report_html(telling(texts)), compared], ids=["report", "comparison"])
def test_texts_of_a_result_are_texts_on_its_page(made, monkeypatch: pytest.MonkeyPatch) -> None:
    plain, hostile = elements(made(HARMLESS)), elements(made(HOSTILE))
    assert hostile == plain and len(plain) > 100
    assert {tag for tag, *_ in plain} & {"script", "style", "table", "option"}
    escaping = page.environment_of
    monkeypatch.setattr(
        page, "environment_of", lambda *names: escaping(*names).overlay(autoescape=False)
    )  # what would be noticed
    assert elements(made(HOSTILE)) != plain  # what would be noticed
