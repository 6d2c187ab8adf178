"""Draw a setting with MuJoCo's offscreen renderer: pictures, as a noisy sensor has them, and masks of the person.

Every picture is what an ideal pinhole camera sees; :class:`SensorNoise` makes a sensor's of it. Masks come
from the segmentation renderer, which has no soft edges: a pixel belongs to what its centre shows. The sensor has

    light = gain_c * flicker_t * picture,    seen = light + level * sqrt(1/2 + light) * e,    e ~ N(0, 1)

with white at 1: half of the noise's variance at mid-grey is there in the dark, and half grows with the light, as the noise of
photons does. Each picture has random numbers of its own by (seed, camera, frame): any of them can be drawn again alone.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseppl.arrays import Floats, Integers
from poseppl.errors import Argument, InputError, PosepplError, cut
from poseppl.motion.rendering.figure import FIGURE_GROUP, SEGMENTS, figure_pose
from poseppl.motion.rendering.room import FURNITURE_GROUP
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


INSTALL = "pip install 'poseppl[render]'"


def load_mujoco() -> Any:
    """Import MuJoCo, set to draw without a screen: ``MUJOCO_GL=egl`` on Linux, unless the user has set it.

    Raises:
        PosepplError: It is not installed, or finds no OpenGL.
    """
    if sys.platform == "linux":
        os.environ.setdefault("MUJOCO_GL", "egl")
    try:
        return importlib.import_module("mujoco")
    except ModuleNotFoundError as error:
        if error.name not in ("mujoco", "OpenGL"):
            raise no_opengl(error) from error
        raise PosepplError(f"rendering needs the package {error.name}, which is not installed: {INSTALL}") from error
    except Exception as error:  # the loader of the GL libraries fails in ways of its own
        raise no_opengl(error) from error


def no_opengl(error: Exception) -> PosepplError:
    """The error to raise where nothing can be drawn."""
    chosen = os.environ.get("MUJOCO_GL", "not set")
    first = (str(error).strip().splitlines() or [type(error).__name__])[0]
    return PosepplError(
        f"MuJoCo finds no OpenGL to draw with, MUJOCO_GL being {chosen} ({cut(first, 200)}); without a screen it needs "
        "MUJOCO_GL=egl, which poseppl sets where you have not, and on Debian: apt-get install libegl1 libgl1 libegl-mesa0"
    )


class SensorNoise(NamedTuple):
    """How bad the cameras are.

    Attributes:
        level: Standard deviation of a pixel at mid-grey, as a fraction of white.
        gain: Standard deviation over cameras of the gain of each colour.
        flicker: Standard deviation over frames of the light.
    """

    level: float = 0.012
    gain: float = 0.03
    flicker: float = 0.004


def check_noise(noise: SensorNoise) -> None:
    """Raise InputError where a level is out of range."""
    for name, value in noise._asdict().items():
        if not 0 <= value <= 0.5:
            raise InputError(
                f"{name} {value:g}", field=Argument("noise"), expected="a fraction of white from 0 to 0.5, such as 0.012"
            )


def camera_gain(noise: SensorNoise, seed: int, camera: int) -> Floats:
    """Gains (3,) of a camera's red, green and blue."""
    gains: Floats = 1 + noise.gain * np.random.default_rng([seed, 5, camera]).standard_normal(3)
    return gains


def expose(picture: Pixels, noise: SensorNoise, seed: int, camera: int, frame: int) -> Pixels:
    """Take a picture as a camera would.

    Args:
        picture: (H, W, 3) red, green, blue.
        noise: How bad the camera is.
        seed: Seed of the random numbers.
        camera: 0-based number of the camera.
        frame: 0-based number of the frame.
    """
    rng = np.random.default_rng([seed, 6, camera, frame])
    light = picture.astype(np.float32) * (camera_gain(noise, seed, camera) / 255).astype(np.float32)
    light *= np.float32(1 + noise.flicker * rng.standard_normal())
    spread = np.float32(noise.level) * np.sqrt(0.5 + np.clip(light, 0, 1), dtype=np.float32)
    return _digital(light + spread * rng.standard_normal(light.shape, dtype=np.float32))


def expose_long(picture: Pixels, noise: SensorNoise, seed: int, camera: int) -> Pixels:
    """The mean of very many exposures of a picture that does not change: the camera's gain without flicker and noise."""
    return _digital((picture * (camera_gain(noise, seed, camera) / 255)).astype(np.float32))


def _digital(light: NDArray[np.float32]) -> Pixels:
    return np.clip(np.round(255 * light), 0, 255).astype(np.uint8)
