"""The truth behind simulated observations, as a file."""

from __future__ import annotations

import json
from os import PathLike

import xarray as xr

from poseppl.errors import InputError
from poseppl.io.files import atomic_path
from poseppl.tracking.scene import Scene


def save_truth(scene: Scene, path: str | PathLike[str]) -> None:
    """Write the truth of a scene as NetCDF: ``state`` (frame, dof), ``markers`` (frame, marker, axis) in mm.

    Args:
        scene: A scene whose truth is known.
        path: The file.

    Raises:
        InputError: The truth is not known, or the file cannot be written.
        PosepplError: The disk is full.
    """
    if scene.states is None or scene.markers is None:
        raise InputError("the truth is not known", file=path)
    tree = scene.body.tree
    truth = xr.Dataset(
        {"state": (("frame", "dof"), scene.states), "markers": (("frame", "marker", "axis"), scene.markers)},
        coords={
            "frame": scene.frames,
            "dof": list(tree.coordinate_names),
            "marker": list(tree.marker_names),
            "axis": ["x", "y", "z"],
        },
    )
    lengths = {name: float(value) for name, value in scene.body.lengths.items()}
    root = xr.Dataset(attrs={"input": scene.source, "rate": scene.rate or 0.0, "lengths": json.dumps(lengths)})
    with atomic_path(path) as temporary:
        xr.DataTree.from_dict({"/": root, "truth": truth}).to_netcdf(temporary, engine="h5netcdf")
