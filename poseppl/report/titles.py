"""Titles of a result: short names of its files, and the algorithms that made it.

>>> short_names("/data/pose/cam1, /data/pose/cam2")
'cam1, cam2'
>>> short_names("run/cam1/points.json, run/cam2/points.json")
'cam1/points.json, cam2/points.json'
"""

from __future__ import annotations

import textwrap
from pathlib import PurePath
from typing import Any

import xarray as xr

from poseppl.runs.results import provenance

MAX_NAMES = 4
MAX_LETTERS = 60
"""Length of a name; a longer one is cut in the middle, so that its ending stays."""


def short_names(paths: str) -> str:
    """Name files by as many of their last parts as distinguish them.

    Args:
        paths: Paths, separated by a comma and a space; other words are returned unchanged.

    Returns:
        At most four names, and how many more there are.
    """
    parts = [PurePath(each).parts for each in paths.split(", ")]
    depth, longest = 1, max(map(len, parts))
    while depth < longest and len({each[-depth:] for each in parts}) < len(set(parts)):
        depth += 1
    names = [_cut("/".join(each[-depth:])) for each in parts]
    more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
    return ", ".join(names[:MAX_NAMES]) + more


def recording_of(tree: xr.DataTree) -> str:
    """The recording by short names; empty where a result does not name it."""
    return short_names(str(provenance(tree).get("input") or ""))


def title_of(tree: xr.DataTree) -> str:
    """The recording, else the model."""
    return recording_of(tree) or _model(provenance(tree)) or "Posterior of a state-space model"


def algorithms_of(tree: xr.DataTree) -> str:
    """Model, filter and smoother."""
    known = provenance(tree)
    names = [_model(known), *(str(known.get(name) or "") for name in ("filter", "smoother"))]
    return " · ".join(name for name in names if name)


def wrapped(title: str, width: int) -> str:
    """A title on at most two lines of so many letters."""
    return "\n".join(textwrap.wrap(title, width, max_lines=2, placeholder=" …"))


def _model(known: dict[str, Any]) -> str:
    """The model's name, without its module or folder."""
    module, _, name = str(known.get("model") or "").rpartition(":")
    return name if module else short_names(name) if name else ""


def _cut(name: str) -> str:
    half = MAX_LETTERS // 2
    return name if len(name) <= MAX_LETTERS else f"{name[: half - 1]}…{name[-half:]}"
