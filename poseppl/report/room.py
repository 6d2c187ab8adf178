"""What stands around a body in space: the floor, the cameras, the rays along which they saw the markers, and flesh."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from poseppl.diagnostics.selection import Array, mean_points
from poseppl.runs.contents import arrays_of, group_of, names_of, variable

NEAR_ZERO = 250.0
"""A floor this near to z = 0 below the lowest marker, mm, is at 0."""
DEPTH = 0.12
"""How deep a camera is drawn, as a share of its distance."""


def room_data(tree: xr.DataTree, chosen: Array) -> dict[str, Any]:
    """Collect what stands around the body.

    Args:
        tree: The result, with a summary of its markers.
        chosen: Indices of the frames that are shown.

    Returns:
        ``floor``, its height in mm; ``cameras`` with ``names``, ``centre`` (C, 3) and ``corners`` (C, 4, 3) of their pictures;
        ``rays``, their ends (frame, C, marker, 3), NaN where nothing was seen; ``flesh``. Each None where the result has none.
    """
    markers = tree["summary"].dataset["markers_mean"].values
    cameras = _cameras(tree, markers)
    return {
        "floor": _floor(markers) if "root" in group_of(tree, "body").attrs else None,
        "cameras": cameras,
        "rays": None if cameras is None else _rays(tree, markers, chosen),
        "flesh": _flesh(tree, chosen),
    }


def _floor(markers: Array) -> float | None:
    """The height that the lowest marker comes down to: 0 where that is near."""
    lowest = np.nanmin(markers[..., 2], axis=1)
    low = float(np.quantile(lowest[np.isfinite(lowest)], 0.02)) if np.isfinite(lowest).any() else np.nan
    return None if np.isnan(low) else 0.0 if -NEAR_ZERO / 2 <= low <= NEAR_ZERO else low


def _cameras(tree: xr.DataTree, markers: Array) -> dict[str, Any] | None:
    lens, points = arrays_of(tree, "camera"), mean_points(tree)
    if points is None or not {"rotation", "centre", "focal", "principal"} <= set(lens):
        return None
    seen = variable(tree, "observed_data", "points")
    both = points if seen is None or seen.shape != points.shape else np.stack([points, seen])
    spread = np.nan_to_num(np.abs(both - lens["principal"][:, None]))
    half = np.quantile(
        spread, 0.99, axis=tuple(axis for axis in range(both.ndim) if axis not in (both.ndim - 3, both.ndim - 1))
    )
    half = np.maximum(half, 0.6 * half.max(axis=1, keepdims=True))
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    directions = _directions(lens, signs * (half / np.abs(lens["focal"]))[:, None])
    middle = np.nanmean(markers, axis=(0, 1))
    depth = DEPTH * np.linalg.norm(lens["centre"] - middle, axis=1)
    corners = lens["centre"][:, None] + depth[:, None, None] * directions
    return {"names": names_of(tree, "camera"), "centre": lens["centre"], "corners": corners}


def _rays(tree: xr.DataTree, markers: Array, chosen: Array) -> Array | None:
    """Where rays through the observed points pass by the mean markers, as far away as these.

    A ray is that to the mean marker, turned by the residual in the image over the focal length: exact without distortion, and
    with it right to first order in the residual.
    """
    seen, points, lens = variable(tree, "observed_data", "points"), mean_points(tree), arrays_of(tree, "camera")
    if seen is None or points is None or seen.shape != points.shape:
        return None
    residual = (seen - points)[chosen] / lens["focal"][:, None]
    away = markers[chosen][:, None] - lens["centre"][:, None]
    local = np.einsum("cij,fcmj->fcmi", lens["rotation"], away)
    depth = local[..., 2:]
    turned = _directions(lens, local[..., :2] / depth + residual)
    return np.asarray(lens["centre"][:, None] + depth * turned)


def _directions(lens: dict[str, Any], slopes: Array) -> Array:
    """Directions (..., C, K, 3) in space, of depth 1, of slopes (..., C, K, 2) in the cameras."""
    local = np.concatenate([slopes, np.ones((*slopes.shape[:-1], 1))], axis=-1)
    return np.asarray(np.einsum("cji,...ckj->...cki", lens["rotation"], local))


def _flesh(tree: xr.DataTree, chosen: Array) -> dict[str, Any] | None:
    parts = arrays_of(tree, "flesh")
    moving = {name: parts[name][chosen] for name in ("base", "tip", "side") if name in parts}
    return parts | moving if moving else None
