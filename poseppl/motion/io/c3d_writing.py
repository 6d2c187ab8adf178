"""Points over time as C3D, through the library ezc3d: places, and beside each how far it may be off, as its residual."""

from __future__ import annotations

import importlib.util
import warnings
from typing import Any

import numpy as np

from poseppl.arrays import Floats, Integers
from poseppl.errors import FilePath, Location, PosepplError
from poseppl.files.atomic_writing import atomic_path
from poseppl.motion.io.motion import Motion

MAX_POINTS, MAX_FRAMES = 255, 65_535
"""Largest number that the format's header can store, with one parameter of names."""
LEVELS = 250
"""A residual is a byte, in units of the file's own: the largest one has this many."""


def write_c3d(path: FilePath, motion: Motion, spread: Floats, frames: Integers) -> None:
    """Write the points of a motion, Z up, in mm.

    Args:
        path: The .c3d file, overwritten if it exists.
        motion: The motion, Z up, in mm. A point that is NaN in a frame becomes a gap: NaN, residual -1, as ezc3d has it.
        spread: (T, J) mm, the residuals, which are kept to a 250th of the largest.
        frames: (T,) frame numbers; the first is the file's first.

    Raises:
        InputError: There are more points or frames than the format holds, or the file cannot be written.
        PosepplError: ezc3d is not installed, or the disk is full.
    """
    ezc3d = load_ezc3d()
    count, points = motion.positions.shape[:2]
    if points > MAX_POINTS or not 0 < count <= MAX_FRAMES:
        expected = f"at most {MAX_POINTS} points and {MAX_FRAMES} frames in a C3D file"
        raise Location(path).error(f"{points} points in {count} frames", expected)
    seen = np.asarray(np.isfinite(motion.positions).all(-1))
    residuals = np.where(seen & np.isfinite(spread), spread, 0.0)
    unit = max(float(residuals.max()) / LEVELS, 1e-3)
    places = np.where(seen[..., None], motion.positions, np.nan)
    file = ezc3d.c3d()
    file["header"]["points"]["first_frame"] = int(max(frames[0], 0))
    point = file["parameters"]["POINT"]
    point["RATE"]["value"] = [float(motion.rate)]
    point["LABELS"]["value"] = list(motion.names)
    point["UNITS"]["value"] = ["mm"]
    point["SCALE"]["value"] = [-unit]
    file.add_parameter("POINT", "X_SCREEN", ["+X"])
    file.add_parameter("POINT", "Y_SCREEN", ["+Z"])
    homogeneous = np.concatenate([places, np.ones((count, points, 1))], -1)
    file["data"]["points"] = np.moveaxis(homogeneous, (0, 1, 2), (2, 1, 0))
    whole = (np.round(residuals / unit) + 0.25) * unit  # ezc3d cuts off what is after the point
    file["data"]["meta_points"]["residuals"] = np.where(seen, whole, -1.0).T[None]
    file["data"]["meta_points"]["camera_masks"] = np.zeros((7, points, count), dtype=bool)
    with atomic_path(path) as temporary:
        file.write(str(temporary))


def load_ezc3d() -> Any:
    """The library ezc3d, imported where its warnings are no errors: ezc3d 1.5 crashes where they are.

    Raises:
        PosepplError: It is not installed.
    """
    if importlib.util.find_spec("ezc3d") is None:
        raise PosepplError("writing .c3d files needs ezc3d: pip install 'poseppl[mocap]'")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return importlib.import_module("ezc3d")
