"""Results whose every text tries to be a script."""

from __future__ import annotations

import json
from typing import Any

import xarray as xr
from synthetic import synthetic_result

HOSTILE = (
    "\"><img src=x onerror='hacked=1'>",
    "</script><script>hacked=1</script>",
    "' onmouseover='hacked=1' x='",
    "<!--<script>hacked=1",
    "<a href='javascript:hacked=1'>b</a>",
    "]]></style></title><svg onload=hacked=1>",
)


def telling(texts: tuple[str, ...]) -> xr.DataTree:
    """A result all of whose names and attributes are these texts in turn, numbered."""
    tree = synthetic_result()
    for group in tree.subtree:
        names = {
            str(dim): [f"{texts[i % len(texts)]}{i}" for i in range(len(values))]
            for dim, values in group.dataset.coords.items()
            if values.dtype.kind == "U" and dim not in ("axis", "xy")
        }
        group.dataset = group.to_dataset().assign_coords(names)
    tree.attrs |= {name: json.dumps(_told(json.loads(value), texts)) for name, value in tree.attrs.items() if _is_text(value)}
    tree.attrs |= {f"{text}{i}": json.dumps({text: [text]}) for i, text in enumerate(texts)}
    return tree


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and value[:1] in '"{['


def _told(value: Any, texts: tuple[str, ...]) -> Any:
    if isinstance(value, str):
        return texts[len(value) % len(texts)]
    if isinstance(value, list):
        return [_told(item, texts) for item in value]
    if isinstance(value, dict):
        return {name: _told(item, texts) for name, item in value.items()}
    return value
