"""Marker trajectories of optical motion capture (C3D).

Only real markers are kept. The reader leaves out the channels that POINT:ANGLES, FORCES, MOMENTS, POWERS and the like list,
unlabelled trajectories ("*12"), and points without data in any frame. It also leaves out the segment frames that Plug-in Gait
stores as four points each (LFEO, LFEA, LFEL, LFEP), and its centre of mass.
"""

from __future__ import annotations

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import Argument, FilePath, Location, Phrase, brief
from poseppl.motion.io.c3d_layout import MAX_POINTS, Layout, Parameters, read_layout
from poseppl.motion.io.c3d_numbers import real_numbers, whole_numbers
from poseppl.motion.io.length_units import mm_per_unit
from poseppl.motion.io.motion import Motion, z_up
from poseppl.motion.io.text_parsing import LARGEST, check_distinct
from poseppl.motion.io.vertical_axis import AXES, vertical_axis

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
