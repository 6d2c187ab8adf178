"""Remedies for a result of tracking: its walk, its noise."""

from __future__ import annotations

import xarray as xr

from poseppl.diagnostics.verdicts.verdict import Remedy
from poseppl.runs.contents import names_of, variable
from poseppl.runs.results import provenance

POSITION, ANGLE = "sigma_position", "sigma_angle"


def of_walk(tree: xr.DataTree, words: str, *arguments: str) -> tuple[Remedy, ...]:
    """To change arguments of the random walk, or what stands in its place where none of them is taken."""
    if variable(tree, "inputs", "posture_mean") is not None:
        return Remedy("use {}", "walk", "learned"), Remedy("use {}", "walk", "fixed")
    if provenance(tree).get("prior"):
        return Remedy("learn the prior from more people (poseppl fit-motion)"), Remedy("track without {}", "prior")
    return tuple(Remedy(words, argument) for argument in arguments)


def in_one_camera(tree: xr.DataTree) -> bool:
    """Whether these are keypoints in one camera: autocorrelated errors count as noise, which is wider than frames differ by."""
    return "layout" in provenance(tree) and len(names_of(tree, "camera")) == 1
