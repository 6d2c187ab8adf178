"""The folder of the bodytrack benchmark as the likelihood takes it, and its first frame as an experiment does.

    BodyShapeParameters.txt    58 numbers: radii and factors of 10 parts, 18 lengths (mm)
    InitialPose.txt            31 numbers: the pose of the frame before the first (mm, radians)
    PoseParameters.txt         31 standard deviations of a frame's motion, 31 lower and 31 upper limits
    poses_reference_apf.txt    31 numbers a frame: poses that a long run of the benchmark's own tracker found; may be absent
    CALIB/Camera1.cal          25 numbers: focal 2, centre 2, skew, distortion 5, rotation 9, translation 3 (mm), its vector 3
    CAM1/image0000.bmp         what the camera saw
    FG1/image0000.bmp          the foreground: every pixel that is not 0

Poses become states of :class:`poseppl_models.bodytrack.likelihood.BodytrackBody`. Rows of images stay in the order in which
they are read: the cameras are calibrated for it, although people are upside down in it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from poseppl.arrays import Floats
from poseppl.errors import FilePath, InputError
from poseppl.files.bounded_reading import read_text
from poseppl.motion.geometry import Cameras
from poseppl.motion.io import read_image
from poseppl.motion.io.text_parsing import lines_of_words, parse_numbers
from poseppl.motion.vision import benchmark_edge_map
from poseppl.program import StateSpaceModel
from poseppl_models.bodytrack.likelihood import (
    BodytrackBody,
    ImageInputs,
    benchmark_score,
    bodytrack,
    bodytrack_body,
    limb_groups,
)
from poseppl_models.bodytrack.outline_samples import pad_maps

Pixels = NDArray[np.uint8]
_DIMENSION = 31
_CAMERAS = (1, 2, 3, 4)
_ORTHOGONAL = 1e-3
"""Largest entry of R R' - 1 of a rotation whose entries are written to a few digits."""


class Bodytrack(NamedTuple):
    """The benchmark's data for T frames of C cameras.

    Attributes:
        body: The person.
        cameras: C cameras, image points in px.
        frames: Numbers of the frames (T,).
        images: Shape (T, C, H, W, 3), RGB.
        foregrounds: Shape (T, C, H, W), 1 where the foreground is, else 0.
        edge_maps: Shape (T, C, H, W), 0 to 255.
        start: Initial pose as a state (31,), mm and radians.
        step_scale: Standard deviations of a frame's motion, in the state's order (31,).
        limits: Lower and upper limits, in the state's order (2, 31); the benchmark reads them and does not use them.
        reference: Reference poses as states (F, 31), the first of frame 0; none where the file is absent.
    """

    body: BodytrackBody
    cameras: Cameras
    frames: tuple[int, ...]
    images: Pixels
    foregrounds: Pixels
    edge_maps: Pixels
    start: Floats
    step_scale: Floats
    limits: Floats
    reference: Floats

    def inputs(self, index: int = 0) -> ImageInputs:
        """Inputs of a frame; in the first state the standard deviations are those of a step, as in the benchmark.

        Args:
            index: Place of the frame among :attr:`frames`.
        """
        edges = pad_maps(jnp.asarray((1.0 - self.edge_maps[index] / 255.0) ** 2, float))
        inside = pad_maps(jnp.asarray(1.0 - self.foregrounds[index], float))
        start, scale = jnp.asarray(self.start, float), jnp.asarray(self.step_scale, float)
        return ImageInputs(self.cameras, edges, inside, start, scale, scale)


def read_bodytrack(folder: FilePath, frames: Sequence[int] = (0,)) -> Bodytrack:
    """Read frames of the benchmark.

    Args:
        folder: Such as ``sequenceB_1``.
        frames: Numbers of the frames, at least one.

    Raises:
        InputError: A file is missing, holds other numbers than expected, or images differ in size.
        PosepplError: OpenCV is not installed.
    """
    place = Path(folder)
    if not place.is_dir():
        raise InputError("no such folder", file=folder, expected="the benchmark's folder, such as sequenceB_1")
    if not frames:
        raise InputError("nothing to read", file=folder, expected="the number of at least one frame")
    body = bodytrack_body(_numbers(place / "BodyShapeParameters.txt", (58,), "10 parts of 4, and 18 lengths (mm)"))
    pose = _numbers(place / "InitialPose.txt", (_DIMENSION,), "one pose")
    kinds = "standard deviations, lower and upper limits, one of each for every entry of a pose"
    scale, *limits = _numbers(place / "PoseParameters.txt", (3, _DIMENSION), kinds)
    images = _images(place, "CAM", frames)
    foregrounds = _images(place, "FG", frames)
    if images.shape != foregrounds.shape:
        sizes = [f"{shape[3]} x {shape[2]}" for shape in (images.shape, foregrounds.shape)]
        raise InputError(f"foregrounds of {sizes[1]} pixels", file=folder, expected=f"{sizes[0]}, as the images have")
    return Bodytrack(
        body=body,
        cameras=_join([_camera(place / "CALIB" / f"Camera{number}.cal") for number in _CAMERAS]),
        frames=tuple(frames),
        images=images,
        foregrounds=(foregrounds[..., 0] > 0).astype(np.uint8),
        edge_maps=np.stack([[benchmark_edge_map(image) for image in views] for views in images]),
        start=body.state_of(pose),
        step_scale=scale[body.order],
        limits=np.sort(body.state_of(np.stack(limits)), axis=0),  # a negated coordinate's lower limit was its upper one
        reference=body.state_of(_reference(place / "poses_reference_apf.txt")),
    )


def _numbers(path: Path, shape: tuple[int, ...], what: str) -> Floats:
    """All numbers of a file, whatever its lines."""
    rows = _rows(path)
    values = np.array([value for row in rows for value in row])
    if values.size != np.prod(shape):
        raise InputError(f"{values.size} numbers", file=path, expected=f"{np.prod(shape)}: {what}")
    return values.reshape(shape)


def _rows(path: Path) -> list[list[float]]:
    """The numbers of each line that has some."""
    return [parse_numbers(words, at) for at, words in lines_of_words(path, read_text(path))]


def _reference(path: Path) -> Floats:
    rows = _rows(path) if path.exists() else []
    for number, row in enumerate(rows, 1):
        if len(row) != _DIMENSION:
            raise InputError(f"pose {number} has {len(row)} numbers", file=path, expected=str(_DIMENSION))
    return np.array(rows).reshape(-1, _DIMENSION)


def _camera(path: Path) -> dict[str, Floats]:
    values = _numbers(path, (25,), "focal 2, centre 2, skew, distortion 5, rotation 9, translation 3, rotation vector 3")
    rotation, translation = values[10:19].reshape(3, 3), values[19:22]
    if np.any(values[[4, 7, 8, 9]] != 0):
        raise InputError("a skew, or more distortion than two radial terms", file=path, expected="0 for entries 5, 8, 9 and 10")
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > _ORTHOGONAL or np.linalg.det(rotation) < 0 or values[:2].min() <= 0:
        raise InputError("no camera", file=path, expected="focal lengths above 0, and a rotation, row by row, from entry 11 on")
    distortion = np.array([values[5], values[6], 0.0, 0.0, 0.0])
    centre = -rotation.T @ translation
    fields = {"rotation": rotation, "centre": centre, "focal": values[:2], "principal": values[2:4]}
    return fields | {"distortion": distortion}


def _join(cameras: Sequence[dict[str, Floats]]) -> Cameras:
    stacked: dict[str, Any] = {name: jnp.asarray(np.stack([one[name] for one in cameras]), float) for name in cameras[0]}
    return Cameras(**stacked)


def _images(folder: Path, kind: str, frames: Sequence[int]) -> Pixels:
    """Images (T, C, H, W, 3) of one size."""
    found: list[Pixels] = []
    for frame in frames:
        for camera in _CAMERAS:
            path = folder / f"{kind}{camera}" / f"image{frame:04d}.bmp"
            image = read_image(path, str(camera), frame)
            if found and image.shape != found[0].shape:
                height, width = found[0].shape[:2]
                problem = f"an image of {image.shape[1]} x {image.shape[0]} pixels"
                raise InputError(problem, file=path, expected=f"{width} x {height}, as the first has")
            found.append(image)
    return np.stack(found).reshape(len(frames), len(_CAMERAS), *found[0].shape)


class BodytrackSystem(NamedTuple):
    """The first frame.

    Attributes:
        program: The programs.
        params: Their params.
        inputs: Their inputs.
        limbs: Coordinates of each limb, for crossover.
        poses: States (31,) by name: "initial", and "reference" where it is known.
        step_scale: Standard deviations of a frame's motion (31,).
        scores: Scores of states by the samples they are taken from, "every" or "few"; of one state (31,).
    """

    program: StateSpaceModel
    params: Mapping[str, float]
    inputs: Any
    limbs: Sequence[Sequence[int]]
    poses: Mapping[str, Floats]
    step_scale: Floats
    scores: Mapping[str, Callable[[Array], Array]]


def bodytrack_system(folder: FilePath) -> BodytrackSystem:
    """Read the benchmark's folder; the programs take every sample.

    Args:
        folder: Such as ``sequenceB_1``.

    Raises:
        InputError: As :func:`poseppl_models.bodytrack.files.read_bodytrack`.
    """
    data = read_bodytrack(folder)
    inputs, body = data.inputs(), data.body

    def score(every: bool) -> Callable[[Array], Array]:
        return lambda state: benchmark_score(body, jnp.asarray(state, float), inputs, every=every)

    poses = {"initial": data.start} | ({"reference": data.reference[0]} if len(data.reference) else {})
    program, scores = bodytrack(body, every=True), {"every": score(True), "few": score(False)}
    return BodytrackSystem(program, {"beta": 1.0}, inputs, limb_groups(body), poses, data.step_scale, scores)
