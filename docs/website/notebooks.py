"""Notebooks: how they are read, and the gallery of their pictures."""

from __future__ import annotations

from typing import Any

import jupytext
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


def read(text: str) -> Any:
    """Read a notebook from its py:percent script."""
    notebook = jupytext.reads(text, fmt="py:percent")
    notebook.metadata["language_info"] = {"name": "python", "pygments_lexer": "python"}
    return notebook


class _Gallery(nodes.General, nodes.Element):
    """The place of the gallery, until all notebooks have been read."""


class _GalleryDirective(SphinxDirective):
    def run(self) -> list[nodes.Node]:
        self.env.note_reread()
        return [_Gallery()]


def _fill(app: Sphinx, doctree: nodes.document, docname: str) -> None:
    """Put a card for each notebook into the gallery: its first picture, its title, how it begins."""
    for place in list(doctree.findall(_Gallery)):
        names = sorted(name for name in app.env.found_docs if name.startswith("notebooks/") and name != docname)
        place.replace_self(nodes.container("", *(_card(app, docname, name) for name in names), classes=["gallery"]))


def _card(app: Sphinx, docname: str, name: str) -> nodes.Node:
    doctree = app.env.get_doctree(name)
    picture = next((image.deepcopy() for image in doctree.findall(nodes.image)), None)
    begins = next((paragraph.astext() for paragraph in doctree.findall(nodes.paragraph)), "")
    link = nodes.reference("", "", refuri=app.builder.get_relative_uri(docname, name), internal=True)
    title = app.env.titles[name].astext()
    if picture is not None:
        for option in ("width", "height", "scale", "align"):
            picture.attributes.pop(option, None)
        picture["alt"] = title
        link += picture
    link += nodes.strong("", title)
    return nodes.container("", nodes.paragraph("", "", link), nodes.paragraph("", _shortened(begins)), classes=["gallery-card"])


def _shortened(text: str, length: int = 160) -> str:
    """The first words of a text, as many as there is room for."""
    flat = " ".join(text.split())
    return flat if len(flat) <= length else flat[:length].rsplit(" ", 1)[0] + " …"


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.add_node(_Gallery)
    app.add_directive("gallery", _GalleryDirective)
    app.connect("doctree-resolved", _fill)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
