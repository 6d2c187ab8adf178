"""The shell of a page: one HTML file that holds its style, data and scripts, and opens without a network.

What comes from results is escaped; and a browser runs no script but the page's own two, which it knows by their hashes, and
fetches nothing (a content security policy).
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import NamedTuple

from plotly.offline import get_plotlyjs


class Section(NamedTuple):
    """A section of a page: its ``name`` in links, its ``title``, and its HTML; left out where that is empty."""

    name: str
    title: str
    content: str


def page_html(
    title: str, subtitle: str, sections: Sequence[Section], *, cards: str, data: Mapping[str, object], script: str
) -> str:
    """Put a page together.

    Args:
        title: Title, plain text.
        subtitle: The line below it, plain text.
        sections: The sections.
        cards: Headline numbers, HTML.
        data: What the script reads, by the id of its element: anything that JSON can hold.
        script: Name of the page's own script among the package's files.

    Returns:
        The whole page.
    """
    present = [section for section in sections if section.content]
    links = "".join(f'<a href="#{section.name}">{section.title}</a>' for section in present)
    body = "".join(f'<section id="{name}"><h2>{label}</h2>{content}</section>' for name, label, content in present)
    held = "".join(f'<script type="application/json" id="{name}">{_json(value)}</script>' for name, value in data.items())
    scripts = get_plotlyjs(), _asset(script)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{_policy(scripts)}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<link rel="icon" href="data:,"><title>{escape(title)} · poseppl</title><style>{_asset("page.css")}</style></head>'
        f"<body><main><header><h1>{escape(title)}</h1><p>{escape(subtitle)}</p></header><nav>{links}</nav>"
        f'<div class="cards">{cards}</div>{body}<footer>Made by poseppl.</footer></main>'
        f"{held}{''.join(f'<script>{text}</script>' for text in scripts)}</body></html>\n"
    )


def card(big: str, small: str) -> str:
    """Lay out a headline number, plain text, with what it is."""
    return f'<div class="card"><b>{escape(big)}</b><span>{escape(small)}</span></div>'


def _policy(scripts: Sequence[str]) -> str:
    """Let these scripts run, and nothing else."""
    hashes = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in scripts]
    known = " ".join(f"'sha256-{value}'" for value in hashes)
    return f"default-src 'none'; script-src {known}; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'"


def _asset(name: str) -> str:
    return files("poseppl.report").joinpath(name).read_text(encoding="utf-8")


def _json(value: object) -> str:
    """JSON that cannot end the script element that holds it."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
