"""Input of every library from a recording, and its output, as files that need NumPy alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np


class Given(NamedTuple):
    """Keypoints of one person in some cameras.

    Attributes:
        points: (T, C, K, 2) px, NaN where the detector saw nothing.
        confidence: (T, C, K) of the detector.
        noise: (T, C, K) standard deviation of a coordinate, px, as poseppl measures it in these cameras alone.
        matrix: (C, 3, 3) of the cameras.
        distortion: (C, 4) of the lenses, as OpenCV has them.
        rotation: (C, 3, 3) from the world to the camera.
        translation: (C, 3) of that, mm.
        size: (C, 2) width and height of the pictures, px.
        cameras: (C,) their numbers, from 1.
        names: (K,) of the joints.
        layout: (K,) the joints' numbers in OpenPose's BODY_25B.
        rate: () frames a second.
    """

    points: Any
    confidence: Any
    noise: Any
    matrix: Any
    distortion: Any
    rotation: Any
    translation: Any
    size: Any
    cameras: Any
    names: Any
    layout: Any
    rate: Any


class Answer(NamedTuple):
    """Places (T, K, 3), mm, and draws of them (S, T, K, 3) where a method has intervals."""

    places: Any
    draws: Any = None


def set_name(cameras: Sequence[int]) -> str:
    """How a set of cameras is called."""
    return "-".join(map(str, cameras))


SETS = ((1, 4), (2, 4), (1, 2, 4))
"""Sets of cameras."""
TIMED = "1-4"
"""The set whose runs are made twice, so that the later run's seconds are known, too."""


def write_given(folder: Path, given: Given) -> None:
    """Write FOLDER/given/SET.npz."""
    (folder / "given").mkdir(parents=True, exist_ok=True)
    np.savez(folder / "given" / f"{set_name(given.cameras)}.npz", **given._asdict())


def read_given(folder: Path) -> dict[str, Given]:
    """Read the files, by the sets' names."""
    found = {}
    for name in map(set_name, SETS):
        path = folder / "given" / f"{name}.npz"
        if path.is_file():
            with np.load(path) as stored:
                found[name] = Given(**{name: stored[name] for name in Given._fields})
    return found


def from_standard_normal(mean: Any, factor: Any, number: int = 200) -> Any:
    """Draws (S, T, K, 3) of Gaussians with a mean (T, K, 3) and a factor (T, K, 3, 3) of the covariance."""
    normal = np.random.default_rng(0).standard_normal((number, *np.shape(mean)))
    return (mean + np.einsum("tkij,stkj->stki", factor, normal)).astype(np.float32)
