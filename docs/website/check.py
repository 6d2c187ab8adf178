"""Check a built site: titles, links within it, and that nothing is fetched from elsewhere."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

FETCHES = {"script": "src", "img": "src", "iframe": "src", "source": "src", "link": "href"}


class Page(HTMLParser):
    """A page as far as the check goes.

    Attributes:
        title: Its title.
        headings: The number of its main headings.
        targets: Ids and names that links can go to.
        links: Targets of its links, and files that it fetches.
        fetches: Files that a browser fetches with it.
    """

    def __init__(self, text: str) -> None:
        super().__init__()
        self.title, self.headings, self._in_title = "", 0, False
        self.targets: set[str] = set()
        self.links: list[str] = []
        self.fetches: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note what a tag says."""
        given = dict(attrs)
        self._in_title |= tag == "title" and not self.title
        self.headings += tag == "h1"
        self.targets |= {name for name in (given.get("id"), given.get("name")) if name}
        fetched = given.get(FETCHES.get(tag, ""))
        if fetched and (tag != "link" or given.get("rel") in ("stylesheet", "icon", "preload")):
            self.fetches.append(fetched)
        self.links += [link for link in (given.get("href"), given.get("src")) if link]

    def handle_data(self, data: str) -> None:
        """Note the title."""
        if self._in_title:
            self.title += data

    def handle_endtag(self, tag: str) -> None:
        """Note where the title ends."""
        self._in_title &= tag != "title"


def faults(site: Path) -> list[str]:
    """All that is wrong with a site; `site` is its folder."""
    pages = {file.resolve(): Page(file.read_text(encoding="utf-8")) for file in sorted(site.rglob("*.html"))}
    found = [] if pages else [f"{site}: no page"]
    for file, page in pages.items():
        name = file.relative_to(site.resolve())
        if page.title.split(" - ")[0].strip() in ("", "<no title>") or not (page.headings or file.name == "search.html"):
            found.append(f"{name}: no title")
        found += [f"{name}: fetched from elsewhere: {each}" for each in page.fetches if urlsplit(each).netloc]
        found += [f"{name}: dead link: {link}" for link in sorted(set(page.links)) if _dead(link, file, site, pages)]
    return found


def _dead(link: str, file: Path, site: Path, pages: dict[Path, Page]) -> bool:
    parts = urlsplit(link)
    if parts.scheme or parts.netloc:
        return False
    target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
    if not target.is_relative_to(site.resolve()) or not target.is_file():
        return True
    return bool(parts.fragment) and target in pages and unquote(parts.fragment) not in pages[target].targets
