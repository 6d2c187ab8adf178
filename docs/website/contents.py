"""The landing page, and the order of the pages; a page that is named nowhere comes last in its part."""

from __future__ import annotations

from collections.abc import Iterable
from fnmatch import fnmatch
from pathlib import Path
from typing import NamedTuple


class Part(NamedTuple):
    """A part of the contents: its heading, the pages that come first, and the pattern of all of them."""

    heading: str
    first: tuple[str, ...]
    pattern: str = ""


PARTS = (
    Part(
        "Tutorials",
        (
            "docs/quickstart",
            *(f"docs/tutorials/{name}" for name in ("smoothing", "sampler", "report", "parameters", "forecasting", "epidemic")),
            "docs/tutorials/cameras",
            "docs/your_cameras",
            "notebooks/index",
        ),
        "docs/tutorials/*.md",
    ),
    Part(
        "How-to guides",
        tuple(
            f"docs/{name}"
            for name in (
                *("your_model", "fitting", "diffuse", "earlier_data", "substeps", "variational", "choosing"),
                *("verdicts", "keypoints", "points", "likelihoods", "opensim", "gait"),
            )
        ),
        "docs/*.md",
    ),
    Part(
        "Concepts",
        tuple(f"docs/concepts/{name}" for name in ("models", "filters", "calibration", "motion")),
        "docs/concepts/*.md",
    ),
    Part(
        "Reference",
        (
            "docs/commands",
            "command_line",
            "reference/index",
            "docs/algorithms",
            *(f"docs/{name}" for name in ("formats", "conventions", "security", "glossary", "bibliography")),
        ),
    ),
    Part("Validation", ("docs/validation/index",), "docs/validation/*.md"),
    Part("Papers", ("docs/validation/errata",), "docs/*/page.md"),
    Part("Develop", ("CONTRIBUTING", "docs/architecture", "CHANGELOG")),
)


def index(names: Iterable[str]) -> str:
    """The landing page, with all pages of the tree in its contents."""
    pages = [name for name in names if name.endswith((".md", ".rst"))]
    known = {name for part in PARTS for name in part.first}
    existing = {name.rsplit(".", 1)[0] for name in pages} | {"notebooks/index"}
    blocks = []
    for part in PARTS:
        others = [name.rsplit(".", 1)[0] for name in pages if part.pattern and matches(name, part.pattern)]
        chosen = [name for name in part.first if name in existing] + [name for name in others if name not in known]
        blocks += ["", "```{toctree}", ":hidden:", f":caption: {part.heading}", "", *chosen, "```"]
    return (Path(__file__).parent / "landing.md").read_text(encoding="utf-8") + "\n".join(blocks) + "\n"


def matches(name: str, pattern: str) -> bool:
    """Whether a path has the pattern's form, in as many folders."""
    return fnmatch(name, pattern) and name.count("/") == pattern.count("/")
