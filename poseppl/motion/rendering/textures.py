"""Surfaces with some life in them, drawn by a seeded generator and handed to MuJoCo as PNG files in memory."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseppl.motion.io.opencv import encode_image

Pixels = NDArray[np.uint8]

SIDE = 256
PLAIN = {
    "ceiling": (0.86, 0.86, 0.84),
    "skirting": (0.82, 0.82, 0.80),
    "door": (0.47, 0.33, 0.22),
    "window": (0.72, 0.82, 0.92),
    "shoes": (0.12, 0.11, 0.11),
    "belt": (0.16, 0.11, 0.08),
    "seat": (0.35, 0.24, 0.16),
}
"""Materials of one colour (red, green, blue from 0 to 1)."""
SHIRTS = ((176, 52, 47), (52, 88, 150), (196, 170, 96), (66, 120, 82), (210, 210, 205))
TROUSERS = ((52, 60, 84), (70, 62, 54), (98, 94, 84), (40, 42, 46))
SKINS = ((224, 177, 148), (198, 145, 112), (141, 94, 68), (98, 66, 50))
HAIRS = ((44, 32, 26), (92, 66, 40), (26, 24, 24), (150, 122, 78))


def room_textures(seed: int) -> dict[str, bytes]:
    """PNG files by material: a floor of planks, walls, wood, a rug, a picture."""
    rng = np.random.default_rng([seed, 2])
    return {
        "floor": encode_image(_planks(rng)),
        "wall": encode_image(_rough((196, 190, 176), 0.025, rng)),
        "wood": encode_image(_grain((138, 92, 56), rng)),
        "rug": encode_image(_stripes((120, 62, 58), (166, 142, 108), 16, 0.08, rng)),
        "picture": encode_image(_blotches(rng)),
    }


def clothes_textures(seed: int) -> dict[str, bytes]:
    """PNG files by material of what a person wears: shirt, trousers, skin, hair."""
    rng = np.random.default_rng([seed, 3])
    shirt, trousers, skin, hair = (palette[rng.integers(len(palette))] for palette in (SHIRTS, TROUSERS, SKINS, HAIRS))
    darker = (int(0.7 * shirt[0]), int(0.7 * shirt[1]), int(0.7 * shirt[2]))
    return {
        "shirt": encode_image(_stripes(shirt, darker, int(rng.integers(12, 40)), 0.05, rng)),
        "trousers": encode_image(_rough(trousers, 0.10, rng)),
        "skin": encode_image(_rough(skin, 0.02, rng)),
        "hair": encode_image(_rough(hair, 0.15, rng)),
    }


def _rough(colour: tuple[int, int, int], spread: float, rng: np.random.Generator) -> Pixels:
    grain = 1 + spread * rng.standard_normal((SIDE, SIDE, 1))
    return _pixels(np.array(colour) * grain)


def _stripes(
    one: tuple[int, int, int], other: tuple[int, int, int], width: int, spread: float, rng: np.random.Generator
) -> Pixels:
    rows = (np.arange(SIDE) // width % 2)[:, None, None]
    return _pixels(np.where(rows == 0, one, other) * (1 + spread * rng.standard_normal((SIDE, SIDE, 1))))


def _grain(colour: tuple[int, int, int], rng: np.random.Generator) -> Pixels:
    lines = np.cumsum(rng.standard_normal((SIDE, 1, 1)), axis=0)
    lines = (lines - lines.mean()) / lines.std()
    return _pixels(np.array(colour) * (1 + 0.08 * lines + 0.03 * rng.standard_normal((SIDE, SIDE, 1))))


def _planks(rng: np.random.Generator) -> Pixels:
    image = _grain((150, 112, 76), rng).astype(float)
    width = SIDE // 8
    for number in range(8):
        row = slice(number * width, (number + 1) * width)
        image[row] *= 1 + 0.08 * rng.standard_normal()
        image[number * width] *= 0.55
        image[row, int(rng.integers(SIDE))] *= 0.55
    return _pixels(image)


def _blotches(rng: np.random.Generator) -> Pixels:
    coarse = rng.uniform(20, 230, (6, 6, 3))
    return _pixels(np.kron(coarse, np.ones((SIDE // 6 + 1, SIDE // 6 + 1, 1)))[:SIDE, :SIDE])


def _pixels(values: NDArray[np.floating[Any]]) -> Pixels:
    return np.clip(np.round(values), 0, 255).astype(np.uint8)
