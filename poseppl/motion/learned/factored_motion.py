"""A recorded walk as tables (:mod:`poseppl.motion.learned.factored_tables`) of a body, and its files."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import xarray as xr

from poseppl.arrays import Floats
from poseppl.errors import Argument, FilePath, InputError
from poseppl.files.netcdf import read_netcdf, write_netcdf
from poseppl.motion.learned.factored_tables import (
    NUM_PHASES,
    ROOT,
    FactoredTables,
    own_steps,
    phases_of,
    root_places,
    train_factored_motion,
)
from poseppl.motion.learned.motion_model import MAX_BYTES, MotionModel, read_motion_model
from poseppl.motion.learned.posed_recordings import PosedRecording

LAYOUT = 3
_EXPECTED = "a file of poseppl fit-motion"


class FactoredMotion(NamedTuple):
    """A recorded walk as tables.

    Attributes:
        body: Builder of the body, by name.
        rate: Frames a second that a row of the tables stands for.
        coordinates: Names of the body's d coordinates.
        tables: The tables of all of them but the root's position and heading.
        step_scale: Root mean square of what a frame's change of position and heading (4,) has beside the mean velocity of its
            phase, mm and radians.
        provenance: Record of its training: file, frames, settings.
    """

    body: str
    rate: float
    coordinates: tuple[str, ...]
    tables: FactoredTables
    step_scale: Floats
    provenance: Mapping[str, Any]


def learn_factored_motion(recording: PosedRecording, body: str, *, num_phases: int = NUM_PHASES) -> FactoredMotion:
    """Learn a walk.

    Args:
        recording: One person who walks straight on, for at least two periods.
        body: Builder of the body whose poses these are.
        num_phases: M.

    Raises:
        InputError: Fewer frames than two periods, or a body without a turn about the vertical.
    """
    coordinates = [(joint, axis) for joint, _, axis in (name.rpartition(".") for name in recording.coordinates)]
    if not {(coordinates[0][0], axis) for axis in ROOT} <= set(coordinates):
        raise InputError(f"{body} does not turn about the vertical", field=Argument("model"), expected="a body that does")
    tables = train_factored_motion(recording.states, coordinates, recording.rate, num_phases=num_phases)
    roots = recording.states[:, root_places(coordinates)]
    phases = phases_of(np.delete(recording.states, root_places(coordinates), axis=1), recording.rate, num_phases)
    left = own_steps(roots) - np.asarray(tables.velocities, np.float64)[phases[1:]] / recording.rate
    level, up, turn = np.mean(left[:, :2] ** 2), np.mean(left[:, 2] ** 2), np.mean(np.diff(roots[:, 3]) ** 2)
    step_scale = np.sqrt(np.maximum([level, level, up, turn], 1e-12))
    record = {
        "file": recording.source,
        "frames": len(recording.states),
        "phases": num_phases,
        "residual mm": round(recording.residual, 3),
    }
    return FactoredMotion(body, recording.rate, recording.coordinates, tables, step_scale, record)


def write_factored_motion(motion: FactoredMotion, path: FilePath) -> None:
    """Write a walk, whole or not at all.

    Raises:
        InputError: The folder is missing or cannot be written.
        PosepplError: The disk is full.
    """
    arrays = {name: (_DIMS[name], np.asarray(getattr(motion.tables, name))) for name in motion.tables._fields}
    arrays["step_scale"] = (_DIMS["step_scale"], motion.step_scale)
    attrs = {
        "poseppl_factored_motion": LAYOUT,
        "body": motion.body,
        "rate": motion.rate,
        "provenance": json.dumps(dict(motion.provenance)),
    }
    write_netcdf(xr.DataTree(xr.Dataset(arrays, {"coordinate": list(motion.coordinates)}, attrs)), path)


def read_factored_motion(path: FilePath) -> FactoredMotion:
    """Read a walk and check that it is one.

    Raises:
        InputError: The file is missing, damaged, of another layout, or holds no walk; the message names the field.
    """
    data = read_netcdf(path, expected=_EXPECTED, max_bytes=MAX_BYTES).to_dataset()
    if data.attrs.get("poseppl_factored_motion") != LAYOUT:
        raise InputError("it has no factored motion of this version", file=path, expected=_EXPECTED)
    for name, dims in _DIMS.items():
        known = name in data and data[name].dims == dims and [data.sizes[dim] for dim in dims] == _sizes(data, dims)
        if not known or not np.isfinite(data[name].values).all():
            raise InputError("missing, not finite, or of other dimensions", file=path, field=name, expected=" x ".join(dims))
        if not _EXPECTS.get(name, _probabilities)(data[name].values):
            expected = "positive numbers" if name in _EXPECTS else "rows that sum to one"
            raise InputError("it is no part of a walk", file=path, field=name, expected=expected)
    try:
        body, rate, provenance = str(data.attrs["body"]), float(data.attrs["rate"]), json.loads(data.attrs["provenance"])
        coordinates = tuple(str(name) for name in data.indexes["coordinate"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"its content is unknown: {error}", file=path, expected=_EXPECTED) from error
    tables = FactoredTables(*(jnp.asarray(data[name].values, float) for name in FactoredTables._fields))
    if len(coordinates) != len(ROOT) + tables.entries.shape[1] or not 0 < rate < 1e6:
        problem = f"{len(coordinates)} coordinates at {rate:g} frames a second"
        raise InputError(problem, file=path, expected=f"{len(ROOT)} more than rotations, and a positive rate")
    return FactoredMotion(body, rate, coordinates, tables, data["step_scale"].values, provenance)


def _sizes(data: xr.Dataset, dims: tuple[str, ...]) -> list[int]:
    """Sizes that dimensions have to have: those of the next frame are those of this one."""
    return [len(ROOT) if dim == "root" else 3 if dim == "axis" else data.sizes[dim.removeprefix("next_")] for dim in dims]


def _probabilities(rows: Floats) -> bool:
    """Whether rows sum to one; those of steps without a successor are zeros."""
    total = rows.sum(-1)
    return bool((rows >= 0).all() and np.all((np.abs(total - 1) < 1e-4) | ((rows.ndim == 4) & (total == 0))))


_EXPECTS: dict[str, Callable[[Any], Any]] = {
    "velocities": lambda values: True,
    "stays": lambda values: 0 <= values <= 1,
    "step_scale": lambda values: (values > 0).all(),
}
"""Conditions for the arrays that are no probabilities."""
_DIMS: dict[str, tuple[str, ...]] = {
    "first_phase": ("phase",),
    "first_bins": ("phase", "rotation", "bin"),
    "phases": ("phase", "next_phase"),
    "entries": ("phase", "rotation", "bin"),
    "steps": ("phase", "rotation", "bin", "next_bin"),
    "velocities": ("phase", "axis"),
    "stays": (),
    "step_scale": ("root",),
}


def read_learned_motion(path: FilePath) -> MotionModel | FactoredMotion:
    """Read a learned motion of either kind.

    Raises:
        InputError: The file is missing, damaged, or holds none.
    """
    kept = read_netcdf(path, expected=_EXPECTED, max_bytes=MAX_BYTES).to_dataset().attrs
    return read_factored_motion(path) if "poseppl_factored_motion" in kept else read_motion_model(path)
