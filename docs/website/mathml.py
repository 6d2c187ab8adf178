"""Formulae as MathML, which browsers draw without a script."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx


def _visit(display: str) -> Any:
    def visit(self: Any, node: nodes.Element) -> None:
        identifier = f' id="{node["ids"][0]}"' if node.get("ids") else ""
        markup = convert(node.astext(), display=display)
        self.body.append(markup if display == "inline" else f'<div class="math"{identifier}>{markup}</div>')
        raise nodes.SkipNode

    return visit


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx as the renderer `mathml`."""
    app.add_html_math_renderer("mathml", (_visit("inline"), None), (_visit("block"), None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
