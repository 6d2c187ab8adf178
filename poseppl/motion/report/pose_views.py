"""Poses as the report's slider and the pictures show them: some frames and draws, and windows around them.

Around a body in space stand the floor, the cameras, the rays along which they saw the markers, and flesh.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from poseppl.arrays import Integers
from poseppl.diagnostics.modes import Modes
from poseppl.diagnostics.selection import Array, evenly, some_draws
from poseppl.motion.measures import edges, image_grows_down, mean_points
from poseppl.motion.verdicts.doubts import Doubts
from poseppl.report.picture import MODES
from poseppl.runs.contents import arrays_of, draws_of, frame_numbers, group_of, names_of, variable

MAX_FRAMES = 120
MAX_SAMPLES, MIN_SAMPLES = 20, 4
MAX_VALUES = 240_000
"""Numbers of the draws in space, and of those in the images: more frames, cameras or markers are shown by fewer draws."""
FARTHEST = 20.0
"""Draws farther from the middle than this many times what is shown are drawn there."""
NEAR_ZERO = 250.0
"""A floor this near to z = 0 below the lowest marker, mm, is at 0."""
DEPTH = 0.12
"""How deep a camera is drawn, as a share of its distance."""


def pose_data(tree: xr.DataTree, frames: Array | None = None) -> dict[str, Any] | None:
    """Collect what is shown of the poses.

    Args:
        tree: The result.
        frames: Indices of frames; evenly spaced ones if None.

    Returns:
        ``frames``, ``edges``, ``markers``, and ``space`` in mm and ``image`` in image units (either may be None), arrays with a
        frame first; None if the result has neither markers nor points.
    """
    chosen = evenly(tree["posterior"].sizes["frame"], MAX_FRAMES) if frames is None else frames
    space, image = _space(tree, chosen), _image(tree, chosen)
    if space is None and image is None:
        return None
    shared = {"frames": frame_numbers(tree)[chosen], "edges": edges(tree), "markers": names_of(tree, "marker")}
    return shared | {"space": space, "image": image}


def doubts_shown(tree: xr.DataTree, doubts: Doubts | None, frames: Integers) -> dict[str, Any] | None:
    """Reasons (frame, marker) in some frames, last of what all share, and their words; None where confidence is high."""
    if doubts is None or (doubts.reasons < 0).all():
        return None
    return {"reasons": doubts.reasons[np.searchsorted(frame_numbers(tree), frames)], "words": doubts.words}


def ghosts(modes: Modes, frames: Integers) -> dict[str, Any] | None:
    """Mean markers (frame, mode, marker, axis) and probabilities (frame, mode) of the modes in some frames, by number.

    None where no frame has several modes, or the result has no markers.
    """
    if modes.means.ndim != 4 or modes.masses.shape[1] < 2:
        return None
    rows = np.searchsorted(modes.frames, frames)
    return {"markers": modes.means[rows], "masses": modes.masses[rows], "colors": MODES}


def _space(tree: xr.DataTree, chosen: Array) -> dict[str, Any] | None:
    mean, draws = variable(tree, "summary", "markers_mean"), some_draws(tree, "markers", _affordable(tree, "markers", chosen))
    if mean is None or draws is None:
        return None
    mean, draws, truth = mean[chosen], np.moveaxis(draws[:, chosen], 1, 0), variable(tree, "truth", "markers")
    centre = (mean.min(axis=1) + mean.max(axis=1)) / 2
    reach = np.nanquantile(np.abs(draws - centre[:, None, None]), 0.995) if np.isfinite(draws).any() else 1000.0
    draws = _within(draws, centre[:, None, None], reach)
    found = {"mean": mean, "draws": draws, "truth": None if truth is None else truth[chosen]}
    shown = {"centre": centre, "reach": float(f"{1.1 * reach:.3g}")}
    return found | shown | room_data(tree, chosen)


def _image(tree: xr.DataTree, chosen: Array) -> dict[str, Any] | None:
    mean, draws = mean_points(tree), some_draws(tree, "points", _affordable(tree, "points", chosen))
    if mean is None or draws is None:
        return None
    mean, draws, seen = mean[chosen], np.moveaxis(draws[:, chosen], 1, 0), variable(tree, "observed_data", "points")
    shown = mean if seen is None else np.where(np.isfinite(seen[chosen]), seen[chosen], mean)
    low, high = np.minimum(mean, shown).min(axis=2), np.maximum(mean, shown).max(axis=2)
    spans = np.where(np.isfinite(high - low), high - low, 0.0).max(axis=2)
    reach = 0.62 * np.quantile(spans, 0.95, axis=0)
    centre, reach = (low + high) / 2, np.where(reach > 0, reach, 1.0)
    return {
        "cameras": names_of(tree, "camera"),
        "mean": mean,
        "draws": _within(draws, centre[:, None, :, None], reach[:, None, None]),
        "observed": None if seen is None else seen[chosen],
        "centre": centre,
        "reach": reach,
        "down": [image_grows_down(tree, camera) for camera in range(mean.shape[1])],
    }


def _affordable(tree: xr.DataTree, name: str, chosen: Array) -> int:
    """How many draws of a variable are shown."""
    values = draws_of(tree, name)
    each = 1 if values is None else len(chosen) * int(np.prod(values.shape[3:]))
    return max(MIN_SAMPLES, min(MAX_SAMPLES, MAX_VALUES // each))


def _within(draws: Array, centre: Array, reach: Any) -> Array:
    """Draws, those that are far away drawn nearer, so that the others are shown as finely as the picture needs."""
    return np.clip(draws, centre - FARTHEST * reach, centre + FARTHEST * reach)


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
    """Points on the rays through the observed points, at the distance of the mean markers.

    A ray is that to the mean marker, turned by the residual in the image over the focal length. This is exact without
    distortion, and correct to first order in the residual with it.
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
