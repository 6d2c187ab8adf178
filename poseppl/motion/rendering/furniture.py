"""A table and chairs that stand in the way of the cameras, but not of the person.

Places are drawn at random beside the path; those are taken that keep clear of it and of each other and are nearest to where
they are wished. Lengths are millimetres; MuJoCo's are metres, and the XML is written in these.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats
from poseppl.motion.rendering.room import CORNERS, Room

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
