"""Pages of one HTML file that contains its style, data and scripts, and opens without a network.

Texts from results are escaped: by Jinja2 in the templates, in the data by the page's script before Plotly reads a text.
A browser runs no script but the page's own, which it knows by their hashes, and fetches nothing (content security policy).

An array of numbers goes in as 16-bit codes between its least and its largest value, base64, and once, however often it stands
in the data. A step is a 65,534th of what is drawn, far below a pixel. Arrays that are positive over more than two powers of ten
may be drawn on a logarithmic scale: these, and short ones, are numbers of five significant figures.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from plotly.graph_objects import Figure
from plotly.offline import get_plotlyjs

DASH = "–"
SHORTEST = 24
"""Arrays with fewer values are numbers."""
MISSING = 65_535
"""The code of what is not finite."""


Column = tuple[str, str, str]
"""The title of a column, the key of its figures in a row, and their format."""


class Extension(NamedTuple):
    """Additions of a package to the reports of its results; its folder `templates` has `sections.html` and `sections.js`.

    Attributes:
        package: Its name.
        cards: Its headline numbers, of :func:`poseppl.report.tables.cards`.
        charts: Its charts by name.
        data: Its data for its script, by the id of their element.
        content: The variables of its template.
        modes: Modes of other quantities than the state; None if it has none.
    """

    package: str
    cards: Sequence[Any] = ()
    charts: Mapping[str, Any] = {}
    data: Mapping[str, Any] = {}
    content: Mapping[str, Any] = {}
    modes: Any = None


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


def with_error(value: float, error: float, digits: int | None = None) -> str:
    """A figure and its standard error, to so many digits, or to two of the error."""
    if not np.isfinite(value):
        return DASH
    if not np.isfinite(error):
        return shown(value)
    if digits is None:
        digits = max(0, 1 - int(np.floor(np.log10(error)))) if error > 0 else 2
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def with_interval(value: float, low: float, high: float, deviation: float = float("nan")) -> str:
    """A figure, a standard deviation if there is one, and an interval, to the first digit of half the interval's width.

    >>> with_interval(1.3052, 1.2731, 1.3409)
    '1.31 (1.27 to 1.34)'
    """
    half = 0.5 * (high - low)
    digits = max(0, -int(np.floor(np.log10(half)))) if np.isfinite(half) and half > 0 else 2
    spread = f" ± {deviation:.{digits}f}" if np.isfinite(deviation) else ""
    return f"{value:.{digits}f}{spread} ({low:.{digits}f} to {high:.{digits}f})"


def filled(columns: Sequence[Column], rows: Sequence[Mapping[str, Any]]) -> list[Column]:
    """Leave columns out in which no row has a figure."""

    def has_figure(value: Any, form: str) -> bool:
        return (value.text if isinstance(value, Cell) else shown(value, form)) != DASH

    return [column for column in columns if any(column[1] in row and has_figure(row[column[1]], column[2]) for row in rows)]


def to_json(value: object) -> str:
    """JSON of ``value``: ``{"arrays": [...], "value": ...}``, in which ``{"array": 3}`` stands for the fourth array."""
    pool: dict[str, int] = {}

    def plain(values: Any) -> Any:
        if isinstance(values, Figure):
            layout = values.layout.to_plotly_json()
            del layout["template"]  # the page has its own
            return {"data": [trace.to_plotly_json() for trace in values.data], "layout": layout}
        array = np.asarray(values)
        code = _coded(array) if array.size >= SHORTEST and array.dtype.kind in "fiu" else None
        return _listed(array) if code is None else {"array": pool.setdefault(code, len(pool))}

    text = json.dumps(value, default=plain, separators=(",", ":"), allow_nan=False)
    return f'{{"arrays":[{",".join(pool)}],"value":{text}}}'


def _coded(values: NDArray[Any]) -> str | None:
    """JSON of an array as codes; None where five significant figures are better."""
    finite = np.isfinite(values)
    known = values[finite].astype(float)
    if not known.size:
        return None
    low, high = float(known.min()), float(known.max())
    whole = bool((known == np.round(known)).all()) and high - low < MISSING
    if not whole and low >= 0 and known[known > 0].min(initial=high) < high / 100:
        return None
    step = 1.0 if whole else (high - low) / (MISSING - 1) or 1.0
    codes = np.full(values.shape, MISSING, "<u2")
    codes[finite] = np.round((known - low) / step)
    coded = base64.b64encode(codes.tobytes()).decode()
    return json.dumps({"shape": values.shape, "low": low, "step": float(f"{step:.9g}"), "codes": coded}, separators=(",", ":"))


def _listed(values: NDArray[Any]) -> Any:
    if values.dtype.kind != "f":
        return values.tolist()
    if values.ndim:
        return [_listed(row) for row in values]
    return float(f"{values:.5g}") if np.isfinite(values) else None


@cache
def environment_of(*packages: str) -> Any:
    """Jinja's environment for the templates of packages; texts are escaped. Pictures need no Jinja, which is imported here."""
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    loader = ChoiceLoader([PackageLoader(package) for package in packages])
    made = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    made.filters |= {"shown": shown, "filled": filled}
    made.policies.update({"json.dumps_function": to_json, "json.dumps_kwargs": {}})
    return made


def page_html(template: str, extension: str = "", **content: Any) -> str:
    """Render a page.

    Args:
        template: Its name among the package's templates.
        extension: A package with sections of its own.
        content: The variables of the template; ``data`` goes to the script, by the id of its element.

    Returns:
        The whole page.
    """
    environment = environment_of("poseppl.report", *filter(None, [extension]))
    loader = environment.loader
    sources = ["page.css", "page.js", *(["sections.js"] if extension else [])]
    style, *own = (loader.get_source(environment, name)[0] for name in sources)
    scripts = [get_plotlyjs(), *own]
    hashes = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in scripts]
    known = " ".join(f"'sha256-{value}'" for value in hashes)
    policy = f"default-src 'none'; script-src {known}; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'"
    trusted = {"style": Markup(style), "scripts": [Markup(text) for text in scripts], "policy": Markup(policy)}
    page: str = environment.get_template(template).render(**trusted, extended=bool(extension), **content)
    return page.strip() + "\n"
