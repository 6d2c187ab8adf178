"""Draw a setting with MuJoCo's offscreen renderer: pictures, and masks of where the person is seen.

Every picture is what an ideal pinhole camera sees; :mod:`poseppl.motion.rendering.noise` makes a sensor's of it. Masks come
from the segmentation renderer, which has no soft edges: a pixel belongs to what its centre shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseppl.arrays import Floats, Integers
from poseppl.motion.rendering.figure import FIGURE_GROUP, SEGMENTS, figure_pose
from poseppl.motion.rendering.furniture import FURNITURE_GROUP
from poseppl.motion.rendering.packages import load_mujoco, no_opengl
from poseppl.motion.rendering.setting import BEAD_GROUP, Setting, setting_model

Mask = NDArray[np.bool_]
Pixels = NDArray[np.uint8]


class Stage:
    """A setting, ready to be drawn. It holds an OpenGL context: use it as ``with Stage(setting) as stage``.

    Args:
        setting: The scene to draw.
        beads: How many small balls can be shown besides.

    Raises:
        PosepplError: MuJoCo is not installed, or finds no OpenGL.
    """

    def __init__(self, setting: Setting, *, beads: int = 0) -> None:
        self._mujoco = load_mujoco()
        xml, files = setting_model(setting, beads)
        self._setting = setting
        self._model = self._mujoco.MjModel.from_xml_string(xml, files)
        self._data = self._mujoco.MjData(self._model)
        width, height = setting.size
        try:
            self._renderer = self._mujoco.Renderer(self._model, height, width)
        except Exception as error:  # each OpenGL loader fails in a way of its own
            raise no_opengl(error) from error
        self._geom = int(self._mujoco.mjtObj.mjOBJ_GEOM)
        self._group: Integers = np.array(self._model.geom_group, np.int64)
        self._pose_beads(np.zeros((beads, 3)))
        self.pose(0)

    def __enter__(self) -> Stage:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Free the OpenGL context."""
        self._renderer.close()

    def pose(self, frame: int) -> None:
        """Let the figure take its pose of a frame, 0-based."""
        places, quaternions = figure_pose(self._setting.figure, frame)
        self._data.mocap_pos[: len(SEGMENTS)] = places
        self._data.mocap_quat[: len(SEGMENTS)] = quaternions
        self._mujoco.mj_forward(self._model, self._data)

    def picture(self, camera: int, *, person: bool = True) -> Pixels:
        """Picture of a camera: (H, W, 3) red, green, blue; the empty room without the person."""
        self._renderer.disable_segmentation_rendering()
        return self._draw(camera, figure=person, furniture=True)

    def visible(self, camera: int) -> Mask:
        """Pixels (H, W) that show the person."""
        return self._mask(camera, FIGURE_GROUP, figure=True, furniture=True)

    def whole(self, camera: int) -> Mask:
        """Pixels (H, W) that would show the person if there were no furniture."""
        return self._mask(camera, FIGURE_GROUP, figure=True, furniture=False)

    def occluder(self, camera: int) -> Pixels:
        """Furniture in the empty room, (H, W): 255 and down, a value for each piece, and 0 elsewhere.

        A person behind it is hidden there, one before it is not.
        """
        geoms = self._segments(camera, self._choice(figure=False, furniture=True))
        own = self._group == FURNITURE_GROUP
        bodies: Integers = np.array(self._model.geom_bodyid, np.int64)
        piece = np.searchsorted(np.unique(bodies[own]), bodies[geoms])
        return np.where((geoms >= 0) & own[geoms], 255 - piece, 0).astype(np.uint8)

    def beads(self, camera: int, places: Sequence[Sequence[float]] | Floats) -> Integers:
        """Show balls at places (B, 3) in mm, alone: for each pixel (H, W) the number of the ball, -1 for none."""
        self._pose_beads(np.asarray(places, np.float64))
        geoms = self._segments(camera, self._option(BEAD_GROUP))
        first = int(np.flatnonzero(self._group == BEAD_GROUP)[0])
        return np.where(geoms >= first, geoms - first, -1)

    def _pose_beads(self, places: Floats) -> None:
        self._data.mocap_pos[len(SEGMENTS) :] = places / 1000.0
        self._mujoco.mj_forward(self._model, self._data)

    def _mask(self, camera: int, group: int, *, figure: bool, furniture: bool) -> Mask:
        """Pixels that show geometry of a group."""
        geoms = self._segments(camera, self._choice(figure, furniture))
        mask: Mask = (geoms >= 0) & (self._group[geoms] == group)
        return mask

    def _segments(self, camera: int, option: Any) -> Integers:
        self._renderer.enable_segmentation_rendering()
        self._renderer.update_scene(self._data, self._setting.cameras[camera].name, option)
        found = self._renderer.render()
        return np.where(found[..., 1] == self._geom, found[..., 0], -1)

    def _draw(self, camera: int, *, figure: bool, furniture: bool) -> Pixels:
        self._renderer.update_scene(self._data, self._setting.cameras[camera].name, self._choice(figure, furniture))
        drawn: Pixels = self._renderer.render()
        return drawn

    def _choice(self, figure: bool, furniture: bool) -> Any:
        return self._option(0, *([FIGURE_GROUP] if figure else []), *([FURNITURE_GROUP] if furniture else []))

    def _option(self, *groups: int) -> Any:
        option = self._mujoco.MjvOption()
        option.geomgroup[:] = 0
        option.geomgroup[list(groups)] = 1
        return option
