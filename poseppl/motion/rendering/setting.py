"""The rendered scene as one MuJoCo model: a figure in motion, the room, what stands in the way, the cameras, and textures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseppl.arrays import Floats
from poseppl.errors import Argument, InputError
from poseppl.motion.io.cameras import CameraRecord
from poseppl.motion.io.opencv import encode_image
from poseppl.motion.rendering.figure import NO_TOES, Figure, dress_figure, figure_points, figure_xml, floor_height
from poseppl.motion.rendering.room import (
    Piece,
    Room,
    camera_xml,
    corner_cameras,
    furniture_xml,
    place_furniture,
    room_around,
    room_xml,
)

BEAD_GROUP = 4
"""MuJoCo's geometry group of the beads, which are drawn only when asked for."""
BEAD = 30.0
"""Radius of a bead, mm."""
_REPEATS = {"floor": "5 5", "wall": "4 2", "wood": "1 1", "rug": "2 2", "picture": "1 1"}


class Setting(NamedTuple):
    """The rendered scene.

    Attributes:
        figure: The person in motion, T frames.
        room: The room.
        furniture: Its furniture; none without clutter.
        cameras: C calibrated cameras, without distortion, their principal point in the middle.
        seed: Seed of surfaces, clothes, build and positions.
    """

    figure: Figure
    room: Room
    furniture: tuple[Piece, ...]
    cameras: tuple[CameraRecord, ...]
    seed: int

    @property
    def num_frames(self) -> int:
        """T."""
        return len(self.figure.points["pelvis"])

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the images in pixels."""
        return self.cameras[0].size


def build_setting(
    names: Sequence[str],
    places: Floats,
    *,
    toes: Mapping[str, Floats] = NO_TOES,
    clutter: bool = True,
    cameras: int = 4,
    size: tuple[int, int] = (640, 480),
    focal: float | None = None,
    seed: int = 0,
) -> Setting:
    """Build a room around a motion.

    Args:
        names: K names of joints, :data:`poseppl.motion.rendering.figure.JOINTS` among them.
        places: (T, K, 3) mm, Z up.
        toes: ``toe_l`` and ``toe_r`` (T, 3) mm, where they are known.
        clutter: Whether a table and chairs stand in the way.
        cameras: How many corners of the room have a camera, 1 to 4.
        size: Width and height of the images in pixels, even numbers.
        focal: Focal length in pixels; that of a horizontal field of view of 70 degrees if None.
        seed: Seed of surfaces, clothes, build and the furniture's positions.

    Raises:
        InputError: A joint is missing or an argument is out of range.
    """
    if len(places) == 0:
        raise InputError("the motion has no frame", field=Argument("frames"), expected="at least one")
    points = figure_points(names, places, toes)
    path = np.stack(list(points.values()), axis=1)[..., :2].reshape(-1, 2)
    room = room_around(path, floor_height(points))
    furniture = place_furniture(room, path, seed) if clutter else ()
    return Setting(dress_figure(points, seed), room, furniture, corner_cameras(room, cameras, size, focal), seed)


def setting_model(setting: Setting, beads: int = 0) -> tuple[str, dict[str, bytes]]:
    """A setting as MJCF, in metres.

    Args:
        setting: The setting.
        beads: How many small balls there are besides, mocap bodies after those of the figure, to mark places with.

    Returns:
        The XML, and the files that it refers to by name.
    """
    images = room_textures(setting.seed) | clothes_textures(setting.seed)
    width, height = setting.size
    middle = " ".join(f"{value / 1000:.6f}" for value in (*setting.room.centre, setting.room.floor))
    xml = f"""<mujoco>
<statistic center="{middle}" extent="1"/>
<visual>
<global offwidth="{width}" offheight="{height}"/>
<quality shadowsize="2048" offsamples="4"/>
<map znear="0.05" zfar="100"/>
<headlight ambient="0.42 0.42 0.42" diffuse="0.08 0.08 0.08" specular="0 0 0"/>
</visual>
<asset>{_assets(images)}</asset>
<worldbody>
{room_xml(setting.room)}
{"".join(map(camera_xml, setting.cameras))}
{furniture_xml(setting.furniture, setting.room.floor)}
{figure_xml(setting.figure)}
{"".join(_bead(number) for number in range(beads))}
</worldbody>
</mujoco>"""
    return xml, {f"{name}.png": data for name, data in images.items()}


def _assets(images: Mapping[str, bytes]) -> str:
    parts = []
    for name in images:
        flat = name in _REPEATS
        repeat = f'texrepeat="{_REPEATS[name]}"' if flat else ""
        parts.append(f'<texture name="{name}" type="{"2d" if flat else "cube"}" file="{name}.png"/>')
        parts.append(f'<material name="{name}" texture="{name}" {repeat} specular="0.1" shininess="0.1"/>')
    for name, colour in PLAIN.items():
        rgba = " ".join(f"{value:g}" for value in (*colour, 1))
        parts.append(f'<material name="{name}" rgba="{rgba}" specular="0.15" shininess="0.2"/>')
    return "\n".join(parts)


def _bead(number: int) -> str:
    return (
        f'<body name="bead_{number}" mocap="true"><geom type="sphere" size="{BEAD / 1000}" rgba="1 0 1 1" '
        f'group="{BEAD_GROUP}" contype="0" conaffinity="0"/></body>'
    )


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
