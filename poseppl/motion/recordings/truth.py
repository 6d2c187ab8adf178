"""The truth behind simulated observations, as a file, and videos of a subject in a room, with the truth."""

from __future__ import annotations

import json
from typing import Any

import xarray as xr

from poseppl.errors import FilePath, InputError
from poseppl.files.netcdf import write_netcdf
from poseppl.motion.bodies.subject import MovingSubject
from poseppl.motion.rendering import Setting, Truth, write_scene
from poseppl.motion.tracking.scene import Scene, SceneData


def save_truth(scene: Scene[SceneData], path: FilePath) -> None:
    """Write the truth of a scene as NetCDF: ``state`` (frame, state_dim), ``markers`` (frame, marker, axis) in mm.

    Args:
        scene: A scene whose truth is known.
        path: The file.

    Raises:
        InputError: The truth is not known, or the file cannot be written.
        PosepplError: The disk is full.
    """
    if scene.states is None or scene.markers is None:
        raise InputError("the truth is not known", file=path)
    rate = scene.rate or 0.0
    save_subject_truth(
        MovingSubject(scene.body, scene.states, scene.markers, scene.residual, scene.frames, rate, scene.source), path
    )


def save_subject_truth(subject: MovingSubject, path: FilePath) -> None:
    """Write a body in motion as :func:`save_truth` does."""
    tree = subject.body.tree
    truth = xr.Dataset(
        {"state": (("frame", "state_dim"), subject.states), "markers": (("frame", "marker", "axis"), subject.markers)},
        coords={
            "frame": subject.frames,
            "state_dim": list(tree.coordinate_names),
            "marker": list(tree.marker_names),
            "axis": ["x", "y", "z"],
        },
    )
    lengths = {name: float(value) for name, value in subject.body.lengths.items()}
    root = xr.Dataset(attrs={"input": subject.source, "rate": subject.rate, "lengths": json.dumps(lengths)})
    write_netcdf(xr.DataTree.from_dict({"/": root, "truth": truth}), path)


def film_subject(folder: FilePath, subject: MovingSubject, setting: Setting, **options: Any) -> None:
    """Render a subject in a setting that was built around its motion, and write the folder.

    Args:
        folder: The folder, which does not exist yet.
        subject: Whose truth is written.
        setting: The rendered scene.
        options: Noise, lossless and advance, as :func:`poseppl.motion.rendering.write_scene` takes them.

    Raises:
        InputError: The folder exists or cannot be made, or an option is out of range.
        PosepplError: A package or OpenGL is missing, or the disk is full.
    """
    truth = Truth(subject.frames, subject.rate, subject.body.tree.marker_names, subject.markers, subject.source)
    write_scene(folder, setting, truth, besides=lambda place: save_subject_truth(subject, place / "truth.nc"), **options)
