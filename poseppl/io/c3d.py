"""Marker trajectories of optical motion capture (C3D), through the library ezc3d.

Only real markers are kept. Left out: the channels that POINT:ANGLES, FORCES, MOMENTS, POWERS and the like name, unlabelled
trajectories ("*12"), the segment frames that Plug-in Gait stores as four points each (LFEO, LFEA, LFEL, LFEP) and its centre of
mass, and points that no frame shows.
"""

from __future__ import annotations

from os import PathLike
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseppl.errors import InputError, PosepplError
from poseppl.io.c3d_layout import check_layout
from poseppl.io.motion import Motion, to_z_up
from poseppl.io.number import LARGEST

MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "dm": 100.0, "m": 1000.0, "in": 25.4}
_MODELLED = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS", "MODELED_MARKERS", "BONES")


def read_c3d(path: str | PathLike[str], *, up: str | None = None) -> Motion:
    """Read the markers of a C3D file.

    Args:
        path: The .c3d file.
        up: The axis that points up, "x", "y" or "z"; by default what POINT:Y_SCREEN says, else "z".

    Returns:
        The motion, Z up, in mm: a cloud of markers without parents; NaN where a marker was not seen.

    Raises:
        InputError: The file is malformed, its unit is unknown, or it holds no marker.
        PosepplError: ezc3d is not installed.
    """
    layout = check_layout(path)
    ezc3d = _library()
    try:
        file = ezc3d.c3d(str(path))
        points = np.asarray(file["data"]["points"], dtype=np.float64)
        parameters = file["parameters"]["POINT"]
        rate = float(parameters["RATE"]["value"][0])
        labels = _texts(parameters, "LABELS", numbered=True)
    except Exception as error:
        raise InputError(f"ezc3d refuses it: {error}", file=path) from error
    if points.ndim != 3 or points.shape[1:] != (layout.points, layout.frames) or len(labels) < layout.points:
        problem = f"{len(labels)} labels for data of shape {points.shape}"
        raise InputError(problem, file=path, field="POINT", expected=f"{layout.points} points in {layout.frames} frames")
    positions = np.moveaxis(points[:3], 0, -1).swapaxes(0, 1) * _unit(path, parameters)
    labels = labels[: layout.points]
    kept = [index for index, label in enumerate(labels) if label and label not in _modelled(parameters, labels)]
    kept = [index for index in kept if np.isfinite(positions[:, index]).all(axis=-1).any()]
    names = tuple(labels[index] for index in kept)
    if not names:
        raise InputError("the file holds no marker", file=path, field="POINT:LABELS")
    repeated = [name for name in names if names.count(name) > 1]
    if repeated:
        raise InputError(f"two markers are called {repeated[0]!r}", file=path, field="POINT:LABELS")
    markers = _clean(path, positions[:, kept])
    return to_z_up(Motion(names, markers, (), None, rate, up or _up(path, parameters), str(path)))


def _library() -> ModuleType:
    try:
        import ezc3d
    except ImportError as error:
        raise PosepplError("reading .c3d files needs ezc3d: pip install 'poseppl[mocap]'") from error
    return ezc3d


def _texts(parameters: Any, name: str, *, numbered: bool = False) -> list[str]:
    texts: list[str] = []
    number = 1
    while name in parameters or number == 1:
        texts += [str(text).strip() for text in parameters[name]["value"]] if name in parameters else []
        number += 1
        name = f"{name.rstrip('0123456789')}{number}"
        if not numbered:
            break
    return texts


def _modelled(parameters: Any, labels: list[str]) -> set[str]:
    known = set(labels)
    names = {name for kind in _MODELLED for name in _texts(parameters, kind)}
    names |= {label for label in labels if label.startswith(("*", "CentreOfMass"))}
    for stem in {label[:-1] for label in labels if label.endswith("O")}:
        quadruple = {stem + letter for letter in "OALP"}
        names |= quadruple if quadruple <= known else set()
    return names


def _unit(path: str | PathLike[str], parameters: Any) -> float:
    units = _texts(parameters, "UNITS")
    unit = units[0].lower() if units else "mm"
    if unit not in MM_PER_UNIT:
        raise InputError(f"unit {unit[:20]!r}", file=path, field="POINT:UNITS", expected=", ".join(MM_PER_UNIT))
    return MM_PER_UNIT[unit]


def _up(path: str | PathLike[str], parameters: Any) -> str:
    screen = "".join(_texts(parameters, "Y_SCREEN")).lower()
    if not screen:
        return "z"
    if screen not in ("+x", "+y", "+z"):
        expected = "+X, +Y or +Z; give the axis that points up explicitly"
        raise InputError(f"the screen's vertical is {screen[:20]!r}", file=path, field="POINT:Y_SCREEN", expected=expected)
    return screen[1]


def _clean(path: str | PathLike[str], positions: NDArray[np.float64]) -> NDArray[np.float64]:
    if np.any(np.abs(positions[np.isfinite(positions)]) > LARGEST) or np.any(np.isinf(positions)):
        raise InputError("a position is infinite or beyond 1e9 mm", file=path, field="data")
    # A marker is seen or not: one missing coordinate takes the others with it.
    return np.where(np.isfinite(positions).all(axis=-1, keepdims=True), positions, np.nan)
