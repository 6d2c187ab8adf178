"""Pages of one HTML file that holds its style, data and scripts, and opens without a network.

What comes from results is escaped: by Jinja2 in the templates, in the data by the page's script before Plotly reads a text.
A browser runs no script but the page's own, which it knows by their hashes, and fetches nothing (content security policy).
"""

from __future__ import annotations

import base64
import hashlib
from typing import Any, NamedTuple

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from poseppl.report.page_data import to_json

DASH = "–"


class Cell(NamedTuple):
    """A cell that is more than text: coloured dots with the names they stand for."""

    text: str
    dots: tuple[tuple[str, str], ...] = ()


def shown(value: Any, form: str = "") -> str:
    """A figure in words, a dash where there is none; to two or three significant digits without a form. Text is text."""
    if isinstance(value, str):
        return value
    if not np.isfinite(value):
        return DASH
    if form:
        return format(value, form)
    if value != 0 and not 1e-3 <= abs(value) < 1e9:
        return f"{value:.1e}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")
    return f"{float(f'{value:.3g}'):,.0f}" if abs(value) >= 100 else f"{value:.2g}"


def _environment() -> Environment:
    made = Environment(loader=PackageLoader("poseppl.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    made.filters["shown"] = shown
    made.policies.update({"json.dumps_function": to_json, "json.dumps_kwargs": {}})
    return made


ENVIRONMENT = _environment()


def page_html(template: str, **content: Any) -> str:
    """Render a page.

    Args:
        template: Its name among the package's templates.
        content: What the template reads; ``data`` goes to the script, by the id of its element.

    Returns:
        The whole page.
    """
    loader = ENVIRONMENT.loader
    assert loader is not None
    style, *own = (loader.get_source(ENVIRONMENT, name)[0] for name in ("page.css", "page.js", "poses.js"))
    scripts = [get_plotlyjs(), *own]
    hashes = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in scripts]
    known = " ".join(f"'sha256-{value}'" for value in hashes)
    policy = f"default-src 'none'; script-src {known}; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'"
    trusted = {"style": Markup(style), "scripts": [Markup(text) for text in scripts], "policy": Markup(policy)}
    return ENVIRONMENT.get_template(template).render(**trusted, **content).strip() + "\n"
