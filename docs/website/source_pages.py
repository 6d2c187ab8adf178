"""Pages of source code without the site's navigation beside them, which took most of the time to write them."""

from __future__ import annotations

from typing import Any

from sphinx.application import Sphinx


def _bare(app: Sphinx, pagename: str, templatename: str, context: dict[str, Any], doctree: Any) -> None:
    if pagename.startswith("_modules/"):
        context["toctree"] = lambda **options: ""


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx, before the theme."""
    app.connect("html-page-context", _bare, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
