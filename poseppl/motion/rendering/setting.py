"""The rendered scene: a figure in motion, the room around it, what stands in the way, and the cameras; as one MuJoCo model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import Argument, InputError
from poseppl.motion.io.cameras import CameraRecord
from poseppl.motion.rendering.figure import Figure, dress_figure, figure_xml
from poseppl.motion.rendering.furniture import Piece, furniture_xml, place_furniture
from poseppl.motion.rendering.points import NO_TOES, figure_points, floor_height
from poseppl.motion.rendering.room import Room, camera_xml, corner_cameras, room_around, room_xml
from poseppl.motion.rendering.textures import PLAIN, clothes_textures, room_textures

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
        names: K names of joints, :data:`poseppl.motion.rendering.points.JOINTS` among them.
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
