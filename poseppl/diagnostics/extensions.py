"""Packages that add to the diagnostics of their own kind of result: measures, checks, and parts of a report."""

from __future__ import annotations

from importlib import import_module
from typing import Any, Literal

import xarray as xr

EXTENSIONS = {"body": "poseppl.motion"}
"""Packages by the group of their results; a file can choose none but these."""


def extension_of(tree: xr.DataTree, part: Literal["measures", "verdicts", "report"]) -> Any:
    """A module of the package for a result of this kind; None where there is none.

    Args:
        tree: The result.
        part: The module: ``measures`` has ``measure(tree)``, more of the group ``diagnostics``; ``verdicts`` has ``CHECKS``;
            ``report`` has ``extension(tree)`` and ``draw_track(upper, lower, tree)``.
    """
    names = [name for group, name in EXTENSIONS.items() if group in tree.children]
    return import_module(f"{names[0]}.{part}") if names else None
