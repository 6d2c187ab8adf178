"""A living room with a camera in every corner, built around whoever walks in it, and furniture in the cameras' way.

After the CLUTTER videos of Peursum, Venkatesh and West 2010 (section 5.1, doi:10.1007/s11263-009-0205-5): 7 m by 6 m, four
cameras below the ceiling, one in each corner. A path that comes nearer than 1.2 m to a wall makes the room larger.

Lengths are millimetres and the world is the motion's, Z up; MuJoCo's are metres, and the XML is written in these. Pixel (0, 0)
has its centre at the image point (0, 0), as in OpenCV, so that the principal point is ((width - 1) / 2, (height - 1) / 2).

The places of furniture are drawn at random beside the path; those are taken that keep clear of it and of each other and are
nearest to where they are wished.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import Argument, InputError
from poseppl.motion.io.cameras import CameraRecord

LONG, SHORT, CEILING = 7000.0, 6000.0, 2750.0
MARGIN = 1200.0
"""Least distance (mm) of a path from the walls."""
CAMERA_HEIGHT, CAMERA_OFF_WALL, LOOK_AT = 2500.0, 200.0, 900.0
"""Height of the cameras, how far they hang off both walls, and the height in the middle of the room they look at, mm."""
HALF_VIEW = np.radians(35.0)
"""Half of a camera's horizontal field of view, unless a focal length is given."""
CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))
MIN_SIDE, MAX_SIDE = 16, 4096


class Room(NamedTuple):
    """A room: ``centre`` (2,) of its floor and ``size`` (2,) along X and Y in mm, and the ``floor``'s height."""

    centre: Floats
    size: Floats
    floor: float


def room_around(path: Floats, floor: float) -> Room:
    """Build the room around a path.

    Args:
        path: (N, 2) mm, where anybody will be, on the floor.
        floor: Height of the floor, mm.
    """
    low, high = path.min(0), path.max(0)
    extent = high - low
    usual = np.array([LONG, SHORT] if extent[0] >= extent[1] else [SHORT, LONG])
    return Room((low + high) / 2, np.maximum(usual, extent + 2 * MARGIN), floor)


def corner_cameras(room: Room, count: int, size: tuple[int, int], focal: float | None = None) -> tuple[CameraRecord, ...]:
    """Calibrations of the cameras in the corners, ``camera_1`` and on, counter-clockwise.

    Args:
        room: The room.
        count: How many of the four corners have one.
        size: Width and height of the image in pixels.
        focal: Focal length in pixels; that of a field of view of 70 degrees if None.

    Raises:
        InputError: The number of cameras, the size or the focal length is out of range.
    """
    if not 1 <= count <= len(CORNERS):
        raise InputError(f"{count} cameras", field=Argument("cameras"), expected="1 to 4, one in each corner of the room")
    if not all(MIN_SIDE <= side <= MAX_SIDE and side % 2 == 0 for side in size):
        expected = f"even numbers of pixels from {MIN_SIDE} to {MAX_SIDE}, which a video needs"
        raise InputError(f"{size[0]} x {size[1]}", field=Argument("size"), expected=expected)
    pixels = size[0] / 2 / np.tan(HALF_VIEW) if focal is None else focal
    if not 0.1 * size[1] <= pixels <= 100 * size[1]:
        expected = f"{0.1 * size[1]:g} to {100 * size[1]:g} pixels for images of {size[1]} lines"
        raise InputError(f"{pixels:g}", field=Argument("focal"), expected=expected)
    matrix = np.array([[pixels, 0, (size[0] - 1) / 2], [0, pixels, (size[1] - 1) / 2], [0, 0, 1.0]])
    target = np.array([*room.centre, room.floor + LOOK_AT])
    records = []
    for number, corner in enumerate(CORNERS[:count]):
        place = room.centre + np.array(corner) * (room.size / 2 - CAMERA_OFF_WALL)
        centre = np.array([*place, room.floor + CAMERA_HEIGHT])
        turn = _level(target - centre)
        records.append(CameraRecord(f"camera_{number + 1}", matrix, np.zeros(5), turn, -turn @ centre, size))
    return tuple(records)


def _level(forward: Floats) -> Floats:
    """Rotation from the world to a camera that looks forward and is not tilted: rows right, down, forward."""
    ahead = forward / np.linalg.norm(forward)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(ahead, right), ahead])


def camera_xml(record: CameraRecord) -> str:
    """A camera of the middle principal point and square pixels as MJCF: MuJoCo's looks along -z, with y up."""
    x, y, z = -record.rotation.T @ record.translation / 1000.0
    right, down, _ = record.rotation
    axes = " ".join(f"{value:.12g}" for value in (*right, *-down))
    fovy = np.degrees(2 * np.arctan(record.size[1] / 2 / record.matrix[1, 1]))
    return f'<camera name="{record.name}" pos="{x:.9g} {y:.9g} {z:.9g}" xyaxes="{axes}" fovy="{fovy:.12g}"/>'


def room_xml(room: Room) -> str:
    """Floor, ceiling, walls, a door, pictures, a window and two lamps, the brighter of which casts shadows, as MJCF."""
    half = room.size / 2000.0
    (x, y), floor, high = room.centre / 1000.0, room.floor / 1000.0, CEILING / 1000.0
    middle = floor + high / 2
    boxes = [
        ("floor", (x, y, floor - 0.05), (half[0], half[1], 0.05)),
        ("ceiling", (x, y, floor + high + 0.05), (half[0], half[1], 0.05)),
    ]
    for sign in (-1, 1):
        boxes += [
            ("wall", (x + sign * (half[0] + 0.05), y, middle), (0.05, half[1] + 0.1, high / 2)),
            ("wall", (x, y + sign * (half[1] + 0.05), middle), (half[0] + 0.1, 0.05, high / 2)),
            ("skirting", (x + sign * half[0], y, floor + 0.05), (0.012, half[1], 0.05)),
            ("skirting", (x, y + sign * half[1], floor + 0.05), (half[0], 0.012, 0.05)),
        ]
    boxes += [
        ("door", (x + 0.45 * half[0], y - half[1], floor + 1.0), (0.42, 0.02, 1.0)),
        ("window", (x - half[0], y + 0.1 * half[1], floor + 1.5), (0.02, 0.8, 0.55)),
        ("picture", (x - 0.3 * half[0], y + half[1], floor + 1.6), (0.45, 0.015, 0.3)),
        ("picture", (x + half[0], y - 0.4 * half[1], floor + 1.55), (0.015, 0.3, 0.4)),
        ("skirting", (x + half[0], y + 0.35 * half[1], floor + 0.4), (0.05, 0.55, 0.28)),
        ("rug", (x + 0.2, y - 0.1, floor), (0.32 * half[0], 0.24 * half[1], 0.004)),
    ]
    return "\n".join([*map(_box_xml, boxes), *_lamps(x, y, floor + high - 0.06, half)])


def _box_xml(box: tuple[str, tuple[float, ...], tuple[float, ...]]) -> str:
    material, place, half = box
    sizes, places = (" ".join(f"{value:.6f}" for value in values) for values in (half, place))
    return f'<geom type="box" size="{sizes}" pos="{places}" material="{material}" contype="0" conaffinity="0"/>'


def _lamps(x: float, y: float, z: float, half: Floats) -> list[str]:
    return [
        f'<light type="spot" pos="{x + sign * 0.35 * half[0]:.4f} {y + sign * 0.2 * half[1]:.4f} {z:.4f}" dir="0 0 -1" '
        f'cutoff="85" exponent="0.6" castshadow="{shadow}" specular="0.1 0.1 0.1" '
        f'diffuse="{level} {level} {0.92 * level:.4f}"/>'
        for sign, level, shadow in ((-1, 0.52, "true"), (1, 0.36, "false"))
    ]


FURNITURE_GROUP = 2
"""MuJoCo's geometry group of the furniture."""
CLEARANCE = 190.0
"""Least distance (mm) from the points of the person to a piece of furniture."""
APART = 60.0
"""Least distance (mm) between two pieces."""
BESIDE = 550.0
"""How far from the path (mm), towards the corners in turn, pieces are wished to stand: where they hide the legs best."""
FROM_WALL = 900.0
"""Least distance (mm) of a piece's middle from the walls."""
NUM_CHAIRS = 6
_TRIALS = 600
_HALF = {"table": np.array([700.0, 400.0]), "chair": np.array([225.0, 225.0])}


class Piece(NamedTuple):
    """A piece of furniture: its ``kind``, where its middle stands (mm), and its turn about Z (radians)."""

    kind: str
    x: float
    y: float
    angle: float


def place_furniture(room: Room, path: Floats, seed: int = 0) -> tuple[Piece, ...]:
    """Put a table and six chairs along a path.

    Args:
        room: The room.
        path: (N, 2) mm, where any part of the person will be.
        seed: Seed of the positions.

    Returns:
        The pieces that found a place; a room full of path has none.
    """
    rng = np.random.default_rng([seed, 4])
    route = path[:: max(1, len(path) // 4000)]
    shares = [0.5, *((number + 0.5) / NUM_CHAIRS for number in range(NUM_CHAIRS))]
    pieces: list[Piece] = []
    for number, (share, kind) in enumerate(zip(shares, ["table"] + ["chair"] * NUM_CHAIRS, strict=True)):
        passed = route[int(share * (len(route) - 1))]
        corner = room.centre + room.size / 2 * CORNERS[number % len(CORNERS)]
        target = passed + BESIDE * (corner - passed) / np.linalg.norm(corner - passed)
        piece = _place(kind, target, room, route, pieces, rng)
        if piece is not None:
            pieces.append(piece)
    return tuple(pieces)


def _place(kind: str, target: Floats, room: Room, route: Floats, others: list[Piece], rng: np.random.Generator) -> Piece | None:
    """The nearest of many places to a target that keeps clear of everything."""
    reach = room.size / 2 - FROM_WALL
    trials = np.clip(target + 800.0 * rng.standard_normal((_TRIALS, 2)), room.centre - reach, room.centre + reach)
    angles = rng.uniform(0, 2 * np.pi, _TRIALS)
    for index in np.argsort(np.linalg.norm(trials - target, axis=-1)):
        piece = Piece(kind, float(trials[index, 0]), float(trials[index, 1]), float(angles[index]))
        if _distance(piece, route) >= CLEARANCE and all(_distance(piece, _outline(other)) >= APART for other in others):
            return piece
    return None


def _distance(piece: Piece, points: Floats) -> float:
    """From a piece's rectangle to the nearest of points (N, 2); 0 inside."""
    local = (points - [piece.x, piece.y]) @ _turn(piece.angle)
    return float(np.linalg.norm(np.maximum(np.abs(local) - _HALF[piece.kind], 0.0), axis=-1).min())


def _outline(piece: Piece) -> Floats:
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 15), np.linspace(-1, 1, 15)), axis=-1).reshape(-1, 2)
    outline: Floats = grid * _HALF[piece.kind] @ _turn(piece.angle).T + [piece.x, piece.y]
    return outline


def _turn(angle: float) -> Floats:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


_Boxes = list[tuple[str, tuple[float, float, float], tuple[float, float, float]]]


def _table() -> _Boxes:
    legs: _Boxes = [("wood", (x * 0.63, y * 0.33, 0.35), (0.035, 0.035, 0.35)) for x in (-1, 1) for y in (-1, 1)]
    return [("wood", (0, 0, 0.735), (0.7, 0.4, 0.02)), ("wood", (0, 0, 0.67), (0.6, 0.3, 0.04)), *legs]


def _chair() -> _Boxes:
    legs: _Boxes = [("wood", (x * 0.195, y * 0.195, 0.22), (0.02, 0.02, 0.22)) for x in (-1, 1) for y in (-1, 1)]
    posts: _Boxes = [("wood", (x * 0.195, -0.2, 0.68), (0.02, 0.016, 0.24)) for x in (-1, 1)]
    return [
        ("seat", (0, 0, 0.455), (0.22, 0.22, 0.022)),
        ("seat", (0, -0.2, 0.73), (0.19, 0.012, 0.16)),
        *legs,
        *posts,
    ]


def furniture_xml(pieces: tuple[Piece, ...], floor: float) -> str:
    """Pieces of furniture as MJCF bodies that stand on a floor (mm)."""
    return "\n".join(_piece_xml(piece, floor) for piece in pieces)


def _piece_xml(piece: Piece, floor: float) -> str:
    half = piece.angle / 2
    geoms = "".join(
        f'<geom type="box" material="{material}" group="{FURNITURE_GROUP}" contype="0" conaffinity="0" '
        f'pos="{_numbers(place)}" size="{_numbers(size)}"/>'
        for material, place, size in (_table() if piece.kind == "table" else _chair())
    )
    place = _numbers((piece.x / 1000, piece.y / 1000, floor / 1000))
    return f'<body pos="{place}" quat="{np.cos(half):.9f} 0 0 {np.sin(half):.9f}">{geoms}</body>'


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:.6f}" for value in values)
