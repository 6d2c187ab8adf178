"""The synthetic walk of :mod:`synthetic` with calibrated cameras in the room, and with flesh."""

from __future__ import annotations

import numpy as np
import xarray as xr
from synthetic import NAMES, synthetic_result

CENTRES = np.array([[500.0, -5000.0, 1000.0], [5500.0, 500.0, 1500.0]])
ROTATIONS = np.array([[[1, 0, 0], [0, 0, -1], [0, 1, 0]], [[0, 1, 0], [0, 0, -1], [-1, 0, 0]]], float)
FOCAL = np.array([[1000.0, 1010.0], [1200.0, 1190.0]])
PRINCIPAL = np.array([[640.0, 512.0], [600.0, 500.0]])


def projected(markers: np.ndarray) -> np.ndarray:
    """Pinhole projections, (..., marker, axis) to (..., camera, marker, xy), by the textbook's formula."""
    local = np.stack([(markers - centre) @ turn.T for centre, turn in zip(CENTRES, ROTATIONS, strict=True)], axis=-3)
    return FOCAL[:, None] * local[..., :2] / local[..., 2:] + PRINCIPAL[:, None]


def room_result(num_frames: int = 12, *, flesh: bool = False) -> xr.DataTree:
    """A walk seen by two cameras; a camera missed a marker in one frame."""
    tree = synthetic_result(num_frames=num_frames)
    markers, frames = tree["posterior/markers"].values.astype(float), tree["posterior"]["frame"].values
    seen = projected(tree["truth/markers"].values) + np.random.default_rng(1).normal(0.0, 3.0, (num_frames, 2, len(NAMES), 2))
    seen[4, 1, 2] = np.nan
    names = {"camera": ["left", "a camera with a long name"], "marker": list(NAMES)}
    points = xr.DataArray(projected(markers), dims=("chain", "draw", "frame", "camera", "marker", "xy"), coords=names)
    posterior = _without(tree["posterior"], "points").assign(points=points)
    observed = xr.Dataset({"points": (("frame", "camera", "marker", "xy"), seen)}, {"frame": frames, **names})
    lens = {"rotation": ROTATIONS, "centre": CENTRES, "focal": FOCAL, "principal": PRINCIPAL}
    dims = {name: ("camera", *(f"{name}_{k}" for k in range(1, value.ndim))) for name, value in lens.items()}
    camera = xr.Dataset({name: (dims[name], value) for name, value in lens.items()}, {"camera": names["camera"]})
    summary = _without(tree["summary"], "points")
    groups = {"posterior": posterior, "observed_data": observed, "camera": camera, "summary": summary}
    tree = tree.assign({name: xr.DataTree(group) for name, group in groups.items()})
    return tree.assign({"flesh": xr.DataTree(_flesh(summary["markers_mean"].values))}) if flesh else tree


def _without(group: xr.DataTree, prefix: str) -> xr.Dataset:
    data = group.to_dataset()
    return data.drop_vars([*(name for name in data.data_vars if str(name).startswith(prefix)), "camera"], errors="ignore")


def _flesh(mean: np.ndarray) -> xr.Dataset:
    """An elliptical trunk from the pelvis to the chest, and a ball for a head."""
    pelvis, chest, head = (mean[:, NAMES.index(name)] for name in ("pelvis", "chest", "head"))
    moving = {"base": np.stack([pelvis, head], 1), "tip": np.stack([chest, head + [0, 0, 0.1]], 1)}
    moving["side"] = np.broadcast_to([0.0, 1.0, 0.0], moving["base"].shape)
    sizes = {"radii": (("part", "end"), [[120.0, 150.0], [110.0, 110.0]]), "scales": (("part", "across"), [[1.3, 0.8], [1, 1]])}
    found = {name: (("frame", "part", "axis"), values) for name, values in moving.items()}
    return xr.Dataset({**found, **sizes, "balls": ("part", [0.0, 1.0])}, {"part": ["trunk", "head"]})
