"""The body that is rendered: a clothed person of capsules and ellipsoids, and the motion's points that it is hung on.

It is nobody's body model: there are no angles and no physics. Every segment is a MuJoCo mocap body. Its z axis runs from one
point to another. Its x axis leans to the person's right, so that y is forward for an upright segment. Thicknesses differ
from person to person by the seed, as clothes and builds do.

Lengths in here are millimetres; MuJoCo's are metres, and the XML is written in these.

The joints go by the names in :data:`JOINTS`. Fingers continue the forearm. Toes come from the recording where it has them; a
foot without is set at a right angle to its shank and kept above the floor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from poseppl.arrays import Floats
from poseppl.errors import InputError
from poseppl.motion.io.motion import Motion

FIGURE_GROUP = 1
"""MuJoCo's geometry group of the figure."""
_VARIATION = 0.06
"""Standard deviation of a shape's thickness from person to person."""


class Shape(NamedTuple):
    """An ellipsoid, or a capsule along its segment.

    Attributes:
        material: Its material.
        axes: Half axes (x, y, z) in mm of an ellipsoid, or the radius (r,) of a capsule, at scale 1.
        place: Position along the segment: the centre of an ellipsoid, or the two ends of a capsule; 0 to 1.
        shift: How far the centre is moved along x and y, mm at scale 1.
    """

    material: str
    axes: tuple[float, ...]
    place: tuple[float, ...]
    shift: tuple[float, float] = (0.0, 0.0)


class Segment(NamedTuple):
    """Shapes between two points of the figure; ``across`` is the pair of joints that tells where right is."""

    start: str
    end: str
    across: str
    shapes: tuple[Shape, ...]


def _limbs(side: str) -> tuple[Segment, ...]:
    inwards = 12.0 if side == "l" else -12.0
    return (
        Segment(
            f"knee_{side}",
            f"hip_{side}",
            "hip",
            (
                Shape("trousers", (60,), (0.0, 1.0)),
                Shape("trousers", (80, 86, 215), (0.66,)),
                Shape("trousers", (66, 70, 110), (0.12,)),
            ),
        ),
        Segment(
            f"ankle_{side}",
            f"knee_{side}",
            "hip",
            (
                Shape("trousers", (47,), (0.12, 1.0)),
                Shape("trousers", (58, 64, 160), (0.66,), (0.0, -12.0)),
                Shape("trousers", (58,), (0.16, 0.34)),
            ),
        ),
        Segment(
            f"heel_{side}",
            f"toe_{side}",
            "hip",
            (Shape("shoes", (36,), (0.05, 0.95)), Shape("shoes", (42, 40, 80), (0.35,), (0.0, -18.0))),
        ),
        Segment(
            f"elbow_{side}",
            f"shoulder_{side}",
            "shoulder",
            (
                Shape("skin", (40,), (0.0, 1.0)),
                Shape("shirt", (56,), (0.5, 1.0)),
                Shape("shirt", (57, 60, 62), (0.98,), (inwards, 0.0)),
            ),
        ),
        Segment(
            f"wrist_{side}",
            f"elbow_{side}",
            "shoulder",
            (Shape("skin", (29,), (0.0, 1.0)), Shape("skin", (40, 42, 95), (0.72,))),
        ),
        Segment(
            f"wrist_{side}",
            f"finger_{side}",
            "shoulder",
            (
                Shape("skin", (18, 40, 85), (0.5,)),
                Shape("skin", (13, 16, 42), (0.42,), (inwards, 34.0)),
            ),
        ),
    )


SEGMENTS = (
    Segment(
        "pelvis",
        "chest",
        "hip",
        (
            Shape("trousers", (165, 112, 120), (-0.1,)),
            Shape("shirt", (150, 112, 140), (0.5,), (0.0, 10.0)),
            Shape("shirt", (118, 80, 100), (0.45,), (0.0, 62.0)),
            Shape("belt", (158, 110, 30), (0.12,), (0.0, 4.0)),
        ),
    ),
    Segment(
        "chest",
        "neck",
        "shoulder",
        (
            Shape("shirt", (160, 112, 190), (0.3,)),
            Shape("shirt", (185, 82, 85), (0.82,)),
        ),
    ),
    Segment(  # sideways: x is down
        "shoulder_l",
        "shoulder_r",
        "shoulder",
        (Shape("shirt", (55,), (0.05, 0.95)), Shape("shirt", (130, 92, 165), (0.5,), (85.0, 0.0))),
    ),
    Segment("neck", "skull", "shoulder", (Shape("skin", (54,), (-0.2, 1.1)),)),
    Segment(
        "skull",
        "crown",
        "shoulder",
        (
            Shape("skin", (74, 92, 115), (0.45,), (0.0, 12.0)),
            Shape("hair", (80, 96, 95), (0.66,), (0.0, -8.0)),
            Shape("skin", (13, 20, 22), (0.35,), (0.0, 100.0)),
        ),
    ),
    *_limbs("l"),
    *_limbs("r"),
)


class Figure(NamedTuple):
    """A figure in motion.

    Attributes:
        points: (T, 3) mm for each point.
        scale: Its size against a person of 1.75 m.
        thickness: One factor for each shape of :data:`SEGMENTS`, in order.
    """

    points: Mapping[str, Floats]
    scale: float
    thickness: Floats


def dress_figure(points: Mapping[str, Floats], seed: int = 0) -> Figure:
    """Make a person of its own from a motion's points.

    Args:
        points: As :func:`poseppl.motion.rendering.figure.figure_points` completes them.
        seed: Seed of the thicknesses; left and right of a body have the same.
    """
    rng = np.random.default_rng([seed, 1])
    factors: dict[str, Floats] = {}
    keys = [f"{segment.start}-{segment.end}".replace("_r", "_l") for segment in SEGMENTS]
    for key, segment in zip(keys, SEGMENTS, strict=True):
        factors.setdefault(key, np.exp(_VARIATION * rng.standard_normal(len(segment.shapes))))
    return Figure(points, figure_scale(points), np.concatenate([factors[key] for key in keys]))


def figure_xml(figure: Figure) -> str:
    """The figure as MJCF bodies, ``segment_0`` and on, in metres."""
    thickness = iter(figure.thickness)
    bodies = []
    for number, segment in enumerate(SEGMENTS):
        length = float(np.median(np.linalg.norm(figure.points[segment.end] - figure.points[segment.start], axis=-1)))
        shapes = "".join(_shape_xml(shape, length, figure.scale, next(thickness)) for shape in segment.shapes)
        bodies.append(f'<body name="segment_{number}" mocap="true">{shapes}</body>')
    return "\n".join(bodies)


def figure_pose(figure: Figure, frame: int) -> tuple[Floats, Floats]:
    """Positions and orientations of the segments in a frame.

    Args:
        figure: The figure.
        frame: 0-based index of the frame.

    Returns:
        Places (S, 3) in metres and unit quaternions (S, 4), w first, of the mocap bodies.
    """
    now = {name: track[frame] for name, track in figure.points.items()}
    places = np.stack([now[segment.start] for segment in SEGMENTS]) / 1000.0
    axes = np.stack([_axes(now, segment) for segment in SEGMENTS])
    quaternions = Rotation.from_matrix(axes).as_quat()
    return places, np.roll(quaternions, 1, axis=-1)


def _axes(points: Mapping[str, Floats], segment: Segment) -> Floats:
    """Columns x, y, z of a segment's frame; where it points to the side, y is turned forward instead."""
    along = unit(points[segment.end] - points[segment.start])
    right = rightwards(points, segment.across)
    across = right - (right @ along) * along
    if np.linalg.norm(across) < 0.2:
        forward = unit(np.cross(np.array([0.0, 0.0, 1.0]), right))
        across = np.cross(forward, along)
    across = unit(across)
    return np.stack([across, np.cross(along, across), along], axis=-1)


def _shape_xml(shape: Shape, length: float, scale: float, thickness: float) -> str:
    x, y = (scale * value / 1000.0 for value in shape.shift)
    common = f'material="{shape.material}" group="{FIGURE_GROUP}" contype="0" conaffinity="0"'
    ends = [length * place / 1000.0 for place in shape.place]
    if len(shape.axes) == 1:
        radius = scale * thickness * shape.axes[0] / 1000.0
        line = f"{x:.6f} {y:.6f} {ends[0]:.6f} {x:.6f} {y:.6f} {ends[1]:.6f}"
        return f'<geom type="capsule" size="{radius:.6f}" fromto="{line}" {common}/>'
    a, b, c = (scale * axis / 1000.0 for axis in shape.axes)
    size = f"{thickness * a:.6f} {thickness * b:.6f} {c:.6f}"
    return f'<geom type="ellipsoid" size="{size}" pos="{x:.6f} {y:.6f} {ends[0]:.6f}" {common}/>'


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
