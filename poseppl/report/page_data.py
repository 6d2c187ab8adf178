"""What the script of a page reads: charts and plain data as JSON, long arrays in few characters.

An array of numbers goes in as 16-bit codes between its least and its largest value, base64, and once, however often it stands
in the data. A step is a 65,534th of what is drawn, far below a pixel. Arrays that are positive over more than two powers of ten
may be drawn on a logarithmic scale: these, and short ones, are numbers of five significant figures.
"""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plotly.graph_objects import Figure

SHORTEST = 24
"""Arrays with fewer values are numbers."""
MISSING = 65_535
"""The code of what is not finite."""


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
