"""The site's parts: links, docstrings, contents, formulae, and the checker that has to notice what is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest
from website.algorithms import algorithms, fields_of, glance
from website.check import faults
from website.commands import contexts, page as commands_page
from website.contents import index
from website.docstrings import marked_up
from website.markup import plain
from website.modules import PACKAGES, all_modules, exports
from website.tree import relinked

GOOD = "<html><head><title>A page</title></head><body><h1 id='a'>A</h1>{}</body></html>"


def site(folder: Path, **bodies: str) -> list[str]:
    """Problems of a site of such pages."""
    for name, body in bodies.items():
        (folder / f"{name}.html").write_text(GOOD.format(body), encoding="utf-8")
    return faults(folder)


def test_a_good_site_has_no_fault(tmp_path: Path) -> None:
    links = "<a href='#a'>a</a> <a href='other.html#a'>b</a> <a href='https://example.org/x'>c</a> <a href='mailto:x@y'>d</a>"
    assert site(tmp_path, index=links, other="") == []


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ("<a href='absent.html'>x</a>", "dead link: absent.html"),
        ("<a href='#absent'>x</a>", "dead link: #absent"),
        ("<a href='index.html#absent'>x</a>", "dead link: index.html#absent"),
        ("<a href='../outside.html'>x</a>", "dead link: ../outside.html"),
        ("<img src='absent.png'>", "dead link: absent.png"),
        ("<script src='https://example.org/x.js'></script>", "fetched from elsewhere"),
        ("<link rel='stylesheet' href='//example.org/x.css'>", "fetched from elsewhere"),
    ],
)
def test_a_dead_link_and_a_fetch_are_faults(tmp_path: Path, body: str, fault: str) -> None:
    found = site(tmp_path, index=body)
    assert len(found) == 1 and fault in found[0]


@pytest.mark.parametrize(
    ("title", "body"),
    [("", "<h1>x</h1>"), (" - poseppl", "<h1>x</h1>"), ("&lt;no title&gt; - poseppl", "<h1>x</h1>"), ("x", "")],
)
def test_a_page_without_a_title_is_a_fault(tmp_path: Path, title: str, body: str) -> None:
    (tmp_path / "index.html").write_text(f"<title>{title}</title>{body}", encoding="utf-8")
    assert faults(tmp_path) == ["index.html: no title"]


def test_no_page_is_a_fault(tmp_path: Path) -> None:
    assert faults(tmp_path) == [f"{tmp_path}: no page"]


def test_every_page_is_in_the_contents_once() -> None:
    names = ["docs/choosing.md", "docs/new.md", "docs/conventions.md", "docs/paper/page.md", "docs/paper/other.md"]
    lines = index([*names, "docs/tutorials/sampler.md", "CHANGELOG.md"]).splitlines()
    for name in ("docs/choosing", "docs/new", "docs/conventions", "docs/paper/page", "docs/tutorials/sampler", "CHANGELOG"):
        assert lines.count(name) == 1
    assert "docs/quickstart" not in lines  # which is not there


def test_every_command_has_a_section_with_its_options() -> None:
    text = commands_page()
    assert all(f"\n## {each.command_path}\n" in text for each in contexts())
    assert "## poseppl run\n" in text and "--filter" in text


def test_links_of_the_repository_hold_on_the_site() -> None:
    there = {"docs/verdicts.md", "reference/poseppl.filters.published.hmc.rst", "reference/poseppl_models.toys.growth.rst"}
    page = Path("docs/choosing.md")
    for link, expected in {
        "[hmc](../poseppl/filters/published/hmc.py)": "[hmc](../reference/poseppl.filters.published.hmc.rst)",
        "[growth](../models/poseppl_models/toys/growth.py)": "[growth](../reference/poseppl_models.toys.growth.rst)",
        "[a](verdicts.md#b)": "[a](verdicts.md#b)",
        "[laws](../tests/catalogue.py)": "laws",
        "[home](../README.md)": "[home](../index.md)",
        "![walk](walk.png)": "![walk](walk.png)",
        "[x](https://example.org/a.py)": "[x](https://example.org/a.py)",
        "[x](#b)": "[x](#b)",
    }.items():
        assert relinked(page, link, there) == expected


@pytest.mark.full
def test_formulae_of_docstrings_are_no_marks() -> None:
    assert plain("|x| and 2*y_ of `a|b*` and :func:`f_`") == r"\|x\| and 2\*y\_ of `a|b*` and :func:`f_`"
    lines = ["Text:", "", "    a_t = |b|", "", "more", "", "Args:", "    x: An x.", "", "Example:", "", "    >>> f(2 * 3)"]
    found = marked_up(lines)
    assert (
        found[2:5] == [".. code-block:: none", "", "    a_t = |b|"]
        and found.count(".. code-block:: none") == 1
        and found[-1] == "    >>> f(2 * 3)"
    )


@pytest.mark.full
def test_every_export_has_a_page_and_every_algorithm_its_settings() -> None:
    pages = {*PACKAGES, *all_modules()}
    for package in PACKAGES:
        assert all(each.module in pages for each in exports(package))
    for each in algorithms():
        text = "\n".join(glance(each.builder.__module__))
        assert f"{each.name}`." in text and all(f":{name}:" in text for name in each.settings)


def test_every_algorithm_has_a_section_with_the_same_fields() -> None:
    for each in algorithms():
        assert list(fields_of(each.builder.__module__)) == ["Computes", "Cost", "Needs", "Fails"], each.name
