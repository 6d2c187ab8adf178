r"""A person of unknown stature, seen by one camera: draws of a body of the mean stature become draws of all statures.

A body s times as large and s times as far from the camera has the same points in the picture. So the points of one camera say
nothing about s, given the pose of a body of the mean stature. Each draw of a trajectory is moved along the camera's rays,

    s ~ N(1, (deviation / mean)^2),    root -> c + s (root - c),    markers -> c + s (markers - c),

c being the camera's centre; angles and points stay. This is the posterior if the walk's steps and the standard deviations of
the start are proportional to the body. A walk in mm would determine s by the distance that a person moves in a frame, which is
not known that precisely.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.special import ndtri

from poseppl.arrays import Floats
from poseppl.program import CompiledModel
from poseppl.runs.contents import FLAT, variable
from poseppl.runs.results import provenance

ATTRIBUTE = "assumed stature"
"""Attribute of a result: mean and standard deviation, mm, of an assumed stature."""
_ROOT = slice(0, 3)
"""The root's place among a tree's coordinates."""


def stature_draws(assumed: ArrayLike, shape: tuple[int, ...]) -> Floats:
    """Draws of a Gaussian stature, mm, of this shape: as even as can be, in random order.

    Args:
        assumed: Its mean and standard deviation, mm.
        shape: Theirs, the same statures whenever it is the same.
    """
    mean, deviation = np.asarray(assumed, np.float64)
    count = int(np.prod(shape))
    even = ndtri((np.arange(count) + 0.5) / count)
    return np.asarray(mean + deviation * np.random.default_rng(0).permutation(even).reshape(shape))


def along_rays(places: ArrayLike, centre: ArrayLike, scale: ArrayLike) -> Floats:
    """Places (..., 3), mm, at other distances, by a factor each, from a camera's centre (3,)."""
    centre = np.asarray(centre, np.float64)
    return np.asarray(centre + scale * (np.asarray(places, np.float64) - centre))


def with_statures(tree: xr.DataTree, model: CompiledModel) -> xr.DataTree:
    """The result of a person of all statures, from that of one of the mean stature; others stay as they are.

    Args:
        tree: The result.
        model: Its model; where the flat state is the pose, sites that hold the root's place are moved, too.

    Returns:
        The result with ``stature`` (chain, draw, frame), mm, in ``posterior``.
    """
    assumed = _assumed(tree)
    if assumed is None:
        return tree
    posterior, flat, summary = (tree[name].to_dataset() for name in ("posterior", FLAT, "summary"))
    centre, state = tree["camera"].dataset["centre"].values[0], flat["state"].values.copy()
    statures = np.broadcast_to(stature_draws(assumed, state.shape[:2])[..., None], state.shape[:3])
    scale, share = statures / assumed[0], assumed[1] / assumed[0]

    def summarise(name: str, moved: Floats, part: slice = slice(None)) -> None:
        """Moments and quantiles of what was moved, a part of the last axis."""
        mean, spread = (np.array(summary[f"{name}_{of}"].values) for of in ("mean", "sd"))
        spread[..., part] = np.sqrt((1 + share**2) * spread[..., part] ** 2 + (share * (mean[..., part] - centre)) ** 2)
        between = np.array(summary[f"{name}_quantile"].values)
        between[..., part] = np.moveaxis(np.quantile(moved, summary["quantile"].values, axis=(0, 1)), 0, 1)
        for of, values in (("sd", spread), ("quantile", between)):
            summary[f"{name}_{of}"] = summary[f"{name}_{of}"].copy(data=values)

    root = along_rays(state[..., _ROOT], centre, scale[..., None])
    markers = along_rays(posterior["markers"].values, centre, scale[..., None, None])
    state[..., _ROOT] = root
    summarise("state", root, _ROOT)
    summarise("markers", markers)
    flat["state"] = flat["state"].copy(data=state)
    posterior["markers"] = posterior["markers"].copy(data=markers.astype(posterior["markers"].dtype))
    for name, columns in _sites_of_root(model, state.shape[-1]).items():
        posterior[name] = posterior[name].copy(data=state[..., columns])
        for of in ("sd", "quantile"):
            values = summary[f"state_{of}"].values[..., columns]
            summary[f"{name}_{of}"] = summary[f"{name}_{of}"].copy(data=values)
    posterior["stature"] = (("chain", "draw", "frame"), statures.astype(state.dtype))
    return tree.assign({"posterior": xr.DataTree(posterior), FLAT: xr.DataTree(flat), "summary": xr.DataTree(summary)})


def at_mean_stature(tree: xr.DataTree) -> xr.DataTree:
    """The result with the flat draws of a body of the mean stature, as the filter had them; others stay as they are."""
    assumed, statures = _assumed(tree), variable(tree, "posterior", "stature")
    if assumed is None or statures is None:
        return tree
    flat, centre = tree[FLAT].to_dataset(), tree["camera"].dataset["centre"].values[0]
    state = flat["state"].values.copy()
    state[..., _ROOT] = along_rays(state[..., _ROOT], centre, (assumed[0] / statures)[..., None])
    return tree.assign({FLAT: xr.DataTree(flat.assign(state=flat["state"].copy(data=state)))})


def _assumed(tree: xr.DataTree) -> Floats | None:
    """Mean and standard deviation of the stature that was assumed, in a result of one camera; None for others."""
    recorded, cameras = provenance(tree).get(ATTRIBUTE), tree.children.get("camera")
    usable = (
        isinstance(recorded, list)
        and len(recorded) == 2
        and all(isinstance(each, int | float) and 0 < each < 1e4 for each in recorded)
    )
    return np.array(recorded, np.float64) if usable and cameras is not None and cameras.sizes["camera"] == 1 else None


def _sites_of_root(model: CompiledModel, dimension: int) -> dict[str, Any]:
    """The coordinates of each site that holds the root's place; none where the flat state is not the pose."""
    if model.dimension != dimension:
        return {}
    found = {name: np.asarray(site.unflatten(jnp.arange(dimension))) for name, site in model.sites.items() if site.identity}
    return {name: columns for name, columns in found.items() if not set(range(3)).isdisjoint(columns.ravel().tolist())}
