"""Sensor of a camera: a gain of its own for each colour, light that flickers, and noise.

    light = gain_c * flicker_t * picture,    seen = light + level * sqrt(1/2 + light) * e,    e ~ N(0, 1)

with white at 1: half of the noise's variance at mid-grey is there in the dark, and half grows with the light, as the noise of
photons does. Each picture has random numbers of its own by (seed, camera, frame): any of them can be drawn again alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseppl.arrays import Floats
from poseppl.errors import Argument, InputError

Pixels = NDArray[np.uint8]


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
