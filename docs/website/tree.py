"""The tree of sources: pages and notebooks as they lie in the repository, the generated ones beside them.

Links between pages are those of the repository, and hold in both; a link to a module leads to its page of the reference.
"""

from __future__ import annotations

import re
from collections.abc import Container
from os.path import normpath, relpath
from pathlib import Path

from website.commands import page as commands_page
from website.contents import index
from website.reference import pages

ROOT = Path(__file__).resolve().parents[2]
COPIED = (
    *(f"docs/**/*.{ending}" for ending in ("md", "png", "svg", "csv")),
    "notebooks/*.py",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
)


def assemble(tree: Path) -> None:
    """Bring a folder up to date; files that have not changed are left alone, so that Sphinx reads them no second time."""
    wanted = {file.relative_to(ROOT): file.read_bytes() for pattern in COPIED for file in ROOT.glob(pattern)}
    wanted = {path: content for path, content in wanted.items() if "website" not in path.parts}
    made = pages() | {"command_line.md": commands_page()}
    there = {*map(str, wanted), *made}
    wanted |= {path: relinked(path, text.decode(), there).encode() for path, text in wanted.items() if path.suffix == ".md"}
    wanted |= {Path(name): text.encode() for name, text in made.items()}
    wanted[Path("index.md")] = index(sorted(map(str, wanted))).encode()
    wanted[Path("notebooks/index.md")] = (Path(__file__).parent / "gallery.md").read_bytes()
    if tree.is_dir():
        for old in [file for file in tree.rglob("*") if file.is_file() and file.relative_to(tree) not in wanted]:
            old.unlink()
    for path, content in wanted.items():
        file = tree / path
        if not file.is_file() or file.read_bytes() != content:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)


def relinked(path: Path, text: str, there: Container[str]) -> str:
    """A page whose links to files of the repository that are not on the site lead to the reference, or are plain text."""

    def link(match: re.Match[str]) -> str:
        words, target = match[1], match[2].partition("#")[0]
        file = normpath(path.parent / target)
        page = f"reference/{file.removeprefix('models/').removeprefix('papers/').removesuffix('.py').replace('/', '.')}.rst"
        if page in there:
            return f"[{words}]({relpath(page, path.parent)})"
        if file == "README.md":
            return f"[{words}]({relpath('index.md', path.parent)})"
        return match[0] if file in there else words

    return re.sub(r"(?<!!)\[([^\]]*)\]\((?!\w+:|#)([^)\s]+)\)", link, text)
