"""Measures of a body's result, in its group ``diagnostics``: errors of the joints, and coverage of their intervals.

``joint_error`` and ``joint_error_relative`` (frame, marker) are in mm. ``coverage_markers`` and ``coverage_markers_se``
(level,) are those of the coordinates of the markers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from poseppl.arrays import Floats
from poseppl.diagnostics.diagnosis import coverage_of_site
from poseppl.runs.contents import draws_of, group_of, names_of, variable


class JointError(NamedTuple):
    """Distances in mm between the posterior mean and the truth, (frame, marker): absolute and relative to the root marker."""

    absolute: Floats
    relative: Floats


def measure(tree: xr.DataTree) -> dict[str, Any]:
    """Measure a result against its truth; nothing where that is not known."""
    mean, markers = variable(tree, "summary", "markers_mean"), variable(tree, "truth", "markers")
    data: dict[str, Any] = {}
    if mean is not None and markers is not None:
        errors = zip(("joint_error", "joint_error_relative"), joint_error(mean, markers, root_index(tree)), strict=True)
        data |= {name: (("frame", "marker"), error) for name, error in errors}
    if markers is not None and draws_of(tree, "markers") is not None:
        data |= coverage_of_site(tree, "markers")[1]
    return data


def joint_error(mean: ArrayLike, truth: ArrayLike, root: int = 0) -> JointError:
    """Distance between estimated and true markers.

    Args:
        mean: (frame, marker, 3) in mm.
        truth: (frame, marker, 3) in mm.
        root: Index of the marker (the pelvis) that is moved onto the truth for the relative error.

    Returns:
        Both errors, in mm.
    """
    difference = np.asarray(mean, np.float64) - np.asarray(truth, np.float64)
    relative = difference - difference[:, root : root + 1]
    return JointError(np.linalg.norm(difference, axis=-1), np.linalg.norm(relative, axis=-1))


def root_index(tree: xr.DataTree) -> int:
    """Index of the marker that relative errors are measured from: :func:`named_root`, or 0 where there is none."""
    return named_root(tree) or 0


def named_root(tree: xr.DataTree) -> int | None:
    """Index of the marker that is the root of a body.

    Args:
        tree: The result.

    Returns:
        The index of the marker named in the attribute ``root`` of ``body``; else of the first marker with "pelvis", "root" or
        "hips" in its name; else None.
    """
    markers = names_of(tree, "marker")
    named = str(group_of(tree, "body").attrs.get("root", ""))
    if named in markers:
        return markers.index(named)
    found = (index for word in ("pelvis", "root", "hips") for index, name in enumerate(markers) if word in name.lower())
    return next(found, None)
