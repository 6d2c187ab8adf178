"""The points that the figure is hung on: a motion's joints, and what follows from them for hands and feet.

The joints go by the names in :data:`JOINTS`. Fingers continue the forearm. Toes come from the recording where it has them; a
foot without is set at a right angle to its shank and kept above the floor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import InputError
from poseppl.motion.io.motion import Motion

JOINTS = (
    "pelvis",
    "chest",
    "neck",
    "skull",
    "crown",
    *(f"{joint}_{side}" for side in "lr" for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")),
)
"""Joints that the figure cannot do without."""
TOES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "toe_l": ("ltoes", "lfoot", "LeftToeBase", "LeftToe", "LToe", "LTOE", "left_toe", "toe_l"),
        "toe_r": ("rtoes", "rfoot", "RightToeBase", "RightToe", "RToe", "RTOE", "right_toe", "toe_r"),
    }
)
"""Names that recordings have for the end of a foot, the most fitting first."""
NO_TOES: Mapping[str, Floats] = MappingProxyType({})

LEG = 830.0
"""Thigh and shank (mm) of a subject of scale 1, 1.75 m tall."""
SOLE = 36.0
"""Radius (mm) of the shoe at scale 1."""
_ANKLE, _HEEL, _FOOT, _HAND = 65.0, 45.0, 190.0, 170.0
"""Height of the ankle above the foot's axis, from the ankle back to the heel, on to the toes, wrist to fingertips, mm."""


def find_toes(motion: Motion) -> dict[str, Floats]:
    """Toes (T, 3) in mm of a recording, where it has them in all frames."""
    found = {}
    for toe, names in TOES.items():
        name = next((name for name in names if name in motion.names), None)
        places = None if name is None else motion.positions[:, motion.index(name)]
        if places is not None and np.isfinite(places).all():
            found[toe] = places
    return found


def figure_points(names: Sequence[str], places: Floats, toes: Mapping[str, Floats] = NO_TOES) -> dict[str, Floats]:
    """Complete a motion's joints to the points of the figure.

    Args:
        names: K names, all of :data:`JOINTS` among them.
        places: (T, K, 3) mm, Z up.
        toes: ``toe_l`` and ``toe_r`` (T, 3), where they are known.

    Returns:
        For each joint, and for ``toe``, ``heel`` and ``finger`` of both sides, its places (T, 3) in mm.

    Raises:
        InputError: A joint is missing, or unknown in a frame.
    """
    missing = [joint for joint in JOINTS if joint not in names]
    if missing:
        raise InputError(
            f"the motion has no {', '.join(missing[:5])}", field="joints", expected="a body with " + ", ".join(JOINTS)
        )
    points = {joint: np.asarray(places[:, list(names).index(joint)], np.float64) for joint in JOINTS}
    for joint, track in points.items():
        unknown = np.flatnonzero(~np.isfinite(track).all(-1))
        if unknown.size:
            raise InputError(f"{joint} is unknown in frame {unknown[0]}", field="joints", expected="a place for every joint")
    size = figure_scale(points)
    ground = min(float(points[f"ankle_{side}"][:, 2].min()) for side in "lr") - (_ANKLE + SOLE / 2) * size
    for side in "lr":
        forearm = unit(points[f"wrist_{side}"] - points[f"elbow_{side}"])
        points[f"finger_{side}"] = points[f"wrist_{side}"] + _HAND * size * forearm
        toe = toes.get(f"toe_{side}")
        points[f"toe_{side}"] = _toe(points, side, size, ground) if toe is None else np.asarray(toe, np.float64)
        points[f"heel_{side}"] = _heel(points, side, size)
    return points


def figure_scale(points: Mapping[str, Floats]) -> float:
    """Size of a person against one of 1.75 m, by the length of the legs."""
    pairs = [(f"{a}_{side}", f"{b}_{side}") for side in "lr" for a, b in (("hip", "knee"), ("knee", "ankle"))]
    return float(sum(np.median(np.linalg.norm(points[a] - points[b], axis=-1)) for a, b in pairs) / (2 * LEG))


def floor_height(points: Mapping[str, Floats]) -> float:
    """Height (mm) of a floor that the lowest shoe of a motion stands on."""
    lowest = min(float(points[f"{end}_{side}"][:, 2].min()) for end in ("heel", "toe") for side in "lr")
    return lowest - SOLE * figure_scale(points)


def unit(vectors: Floats) -> Floats:
    """Vectors (..., 3) of length 1; a vector of no length stays so."""
    lengths: Floats = np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)
    return vectors / lengths


def rightwards(points: Mapping[str, Floats], joint: str) -> Floats:
    """Unit vectors (T, 3) from a left joint to the right one."""
    return unit(points[f"{joint}_r"] - points[f"{joint}_l"])


def _toe(points: Mapping[str, Floats], side: str, size: float, ground: float) -> Floats:
    """At a right angle to the shank, a little downwards, and above the floor."""
    shank = unit(points[f"ankle_{side}"] - points[f"knee_{side}"])
    forward = unit(np.cross(rightwards(points, "hip"), shank))
    # right x down is forward for a leg that hangs
    toe = points[f"ankle_{side}"] + size * (_FOOT * unit(forward + 0.35 * shank))
    toe[:, 2] = np.maximum(toe[:, 2], ground + SOLE * size)
    return toe


def _heel(points: Mapping[str, Floats], side: str, size: float) -> Floats:
    along = unit(points[f"toe_{side}"] - points[f"ankle_{side}"])
    upwards = unit(np.cross(rightwards(points, "hip"), along))
    heel: Floats = points[f"ankle_{side}"] - size * (_ANKLE * upwards + _HEEL * along)
    return heel
