"""Marker trajectories of optical motion capture (C3D): read here, written through the library ezc3d.

Only real markers are kept. The reader leaves out the channels that POINT:ANGLES, FORCES, MOMENTS, POWERS and the like list,
unlabelled trajectories ("*12"), and points without data in any frame. It also leaves out the segment frames that Plug-in Gait
stores as four points each (LFEO, LFEA, LFEL, LFEP), and its centre of mass.
"""

from __future__ import annotations

import importlib.util
import warnings
from typing import Any

import numpy as np

from poseppl.arrays import Floats, Integers
from poseppl.errors import Argument, FilePath, Location, Phrase, PosepplError, brief
from poseppl.files.atomic_writing import atomic_path
from poseppl.motion.io.c3d_layout import MAX_POINTS, Layout, Parameters, read_layout, real_numbers, whole_numbers
from poseppl.motion.io.motion import Motion, z_up
from poseppl.motion.io.text_parsing import LARGEST, check_distinct
from poseppl.motion.io.units_and_axes import AXES, mm_per_unit, vertical_axis

_MODELLED = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS", "MODELED_MARKERS", "BONES")


def read_c3d(path: FilePath, *, up: str | None = None) -> Motion:
    """Read the markers of a C3D file.

    Args:
        path: The .c3d file.
        up: The axis that points up; by default what POINT:Y_SCREEN says, or the axis along which the head is above the feet.

    Returns:
        The motion, Z up, in mm: a cloud of markers without parents; NaN where a marker was not seen.

    Raises:
        InputError: The file is malformed, its unit is unknown, or it holds no marker.
    """
    layout, at = read_layout(path), Location(path)
    labels = _labels(layout.parameters)
    if len(labels) < layout.points:
        raise at.in_field("POINT").error(f"{len(labels)} labels for {layout.points} points", "one a point")
    positions = _positions(layout) * mm_per_unit(_unit(layout.parameters), at.in_field("POINT:UNITS"))
    labels = labels[: layout.points]
    modelled = _modelled(layout.parameters, labels)
    kept = [index for index, label in enumerate(labels) if label and label not in modelled]
    kept = [index for index in kept if np.isfinite(positions[:, index]).all(axis=-1).any()]
    names = tuple(labels[index] for index in kept)
    at_labels = at.in_field("POINT:LABELS")
    if not names:
        raise at_labels.error("the file has no marker")
    check_distinct(names, "markers", at_labels)
    markers = _clean(at, positions[:, kept])
    stated = None if up else _stated_up(at, layout.parameters)
    vertical = vertical_axis(names, markers, given=up, stated=stated, stated_by="POINT:Y_SCREEN", usual="z", kind="C3D files")
    return Motion(names, z_up(markers, vertical.axis), (), layout.rate, str(path), (vertical.note(),))


def _positions(layout: Layout) -> Floats:
    """Positions (T, K, 3) in the file's unit, NaN where the residual after them is negative."""
    whole = layout.scale > 0
    numbers = (whole_numbers if whole else real_numbers)(layout.stored, layout.processor)
    numbers = numbers.view(np.int16) * layout.scale if whole else numbers.astype(np.float64)
    points = numbers.reshape(layout.frames, -1)[:, : 4 * layout.points].reshape(layout.frames, -1, 4)
    return np.where(points[..., 3:] < 0, np.nan, points[..., :3])


def _labels(parameters: Parameters) -> list[str]:
    # More than 255 points go on in LABELS2, LABELS3, ...
    names = ("POINT:LABELS", *(f"POINT:LABELS{number}" for number in range(2, MAX_POINTS // 255 + 2)))
    return [label for name in names for label in parameters.texts(name)]


def _modelled(parameters: Parameters, labels: list[str]) -> set[str]:
    known = set(labels)
    names = {name for kind in _MODELLED for name in parameters.texts(f"POINT:{kind}")}
    names |= {label for label in labels if label.startswith(("*", "CentreOfMass"))}
    for stem in {label[:-1] for label in labels if label.endswith("O")}:
        quadruple = {stem + letter for letter in "OALP"}
        names |= quadruple if quadruple <= known else set()
    return names


def _unit(parameters: Parameters) -> str:
    units = parameters.texts("POINT:UNITS")
    return units[0].lower() if units else "mm"


def _stated_up(at: Location, parameters: Parameters) -> str | None:
    screen = "".join(parameters.texts("POINT:Y_SCREEN")).lower().removeprefix("+")
    if screen and screen not in AXES:
        raise at.in_field("POINT:Y_SCREEN").error(
            f"the screen's vertical is {brief(screen)}", Phrase("+X, +Y or +Z; or use ", Argument("up", "z"))
        )
    return screen or None


def _clean(at: Location, positions: Floats) -> Floats:
    if np.any(np.abs(positions[np.isfinite(positions)]) > LARGEST) or np.any(np.isinf(positions)):
        raise at.in_field("data").error("a position is infinite or beyond 1e9 mm")
    # A marker is seen or not: one missing coordinate takes the others with it.
    return np.where(np.isfinite(positions).all(axis=-1, keepdims=True), positions, np.nan)


MAX_WRITTEN_POINTS, MAX_FRAMES = 255, 65_535
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
    if points > MAX_WRITTEN_POINTS or not 0 < count <= MAX_FRAMES:
        expected = f"at most {MAX_WRITTEN_POINTS} points and {MAX_FRAMES} frames in a C3D file"
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
