"""A body's result: errors of the joints, coverage of their intervals, its skeleton, and its projected points.

``joint_error`` and ``joint_error_relative`` (frame, marker) are in mm. ``coverage_markers`` and ``coverage_markers_se``
(level,) are those of the coordinates of the markers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from poseppl.arrays import Floats, Integers
from poseppl.diagnostics.diagnosis import coverage_of_site
from poseppl.diagnostics.selection import Array, some_draws
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


def edges(tree: xr.DataTree) -> Integers:
    """Pairs of markers between which the skeleton is drawn, (edge, 2); none if the result names none."""
    found = variable(tree, "body", "edges")
    return np.zeros((0, 2), np.int64) if found is None else found.astype(np.int64)


def segments(points: Array, pairs: Integers) -> Array:
    """Lay a skeleton out as one broken line.

    Args:
        points: (..., marker, k).
        pairs: (edge, 2).

    Returns:
        (..., 3 edges, k), each third point NaN.
    """
    ends = points[..., pairs, :].astype(np.float64)
    gap = np.full((*ends.shape[:-2], 1, ends.shape[-1]), np.nan)
    whole = np.concatenate([ends, gap], axis=-2)
    return whole.reshape(*points.shape[:-2], -1, points.shape[-1])


def mean_points(tree: xr.DataTree) -> Array | None:
    """Mean of the projected draws, (frame, camera, marker, xy): from the summary, else from the draws."""
    found = variable(tree, "summary", "points_mean")
    if found is not None:
        return found
    draws = draws_of(tree, "points")
    return None if draws is None else np.asarray(draws.mean(axis=(0, 1), dtype=np.float64))


def image_grows_down(tree: xr.DataTree, camera: int) -> bool:
    """Whether y of an image points down, as in pixels; the camera of Choo and Fleet (negative focal length in y) has it up."""
    focal = variable(tree, "camera", "focal")
    return focal is not None and bool(np.asarray(focal).reshape(len(focal), -1)[camera, -1] > 0)


def expected_error(tree: xr.DataTree, most: int = 200) -> Array | None:
    """The error that the posterior itself expects: distance of its draws from its mean, averaged over the markers.

    Args:
        tree: The result.
        most: How many draws are used.

    Returns:
        (3, frame): the 5 %, 50 % and 95 % quantiles over draws, in mm; None without markers.
    """
    draws, mean = some_draws(tree, "markers", most), variable(tree, "summary", "markers_mean")
    if draws is None or mean is None:
        return None
    distance = np.linalg.norm(draws - mean, axis=-1).mean(axis=-1)
    return np.asarray(np.quantile(distance, [0.05, 0.5, 0.95], axis=0))
