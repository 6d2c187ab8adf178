"""A rendered scene as a folder of files, written whole or not at all.

    scene.toml                   its settings
    Calib.toml                   the cameras, as poseppl.motion.io.read_cameras has them
    truth.csv                    true places of the markers, as poseppl.motion.io.read_places has them
    camera_1.mp4                 what a camera saw, lossy
    camera_1/000000.png          the same without loss, when asked for
    camera_1_visible.npz         where the person was seen: keys masks (packed bits) and shape
    camera_1_whole.npz           where the person would have been seen without furniture
    camera_1_background.png      the empty room, furniture included, through the same camera without noise
    camera_1_occluder.png        where furniture is seen in the empty room: nearly white, a gray for each piece; black elsewhere

A pixel of ``whole`` that is not in ``visible`` is hidden by furniture. The occluder does not say that: a person before the
furniture is seen there. Image points have their origin in the centre of the first pixel, as in OpenCV.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseppl.arrays import Floats, Integers
from poseppl.errors import Argument, FilePath, InputError
from poseppl.files.atomic_writing import atomic_folder
from poseppl.motion.io.cameras import quoted, write_cameras
from poseppl.motion.io.masks import write_masks
from poseppl.motion.io.observations import write_places
from poseppl.motion.io.opencv import write_image
from poseppl.motion.io.video_writing import VideoWriter, video_writer
from poseppl.motion.rendering.render import SensorNoise, Stage, check_noise, expose, expose_long
from poseppl.motion.rendering.setting import Setting

MAX_RATE = 1000.0


class Truth(NamedTuple):
    """Truth of the motion.

    Attributes:
        frames: (T,) frame numbers.
        rate: Frames a second.
        names: K names of markers.
        places: (T, K, 3) mm; NaN where unknown.
        source: Source of the motion.
    """

    frames: Integers
    rate: float
    names: Sequence[str]
    places: Floats
    source: str


def _nothing(*_: object) -> None:
    """Report nothing."""


def write_scene(
    path: FilePath,
    setting: Setting,
    truth: Truth,
    *,
    noise: SensorNoise | None = None,
    lossless: bool = False,
    advance: Callable[[int], None] = _nothing,
    besides: Callable[[Path], None] = _nothing,
) -> None:
    """Render a scene and write its folder.

    Args:
        path: The folder, which does not exist yet.
        setting: The scene to render, T frames.
        truth: Its truth, T frames.
        noise: Noise of the sensors; the usual one if None. Its seed is the setting's.
        lossless: Whether every frame is written as PNG, too.
        advance: Receives the number of frames rendered since the last call.
        besides: Writes more files into the folder before it gets its name.

    Raises:
        InputError: The folder exists or cannot be made, or an argument is out of range.
        PosepplError: A package or OpenGL is missing, or the disk is full.
    """
    noise = SensorNoise() if noise is None else noise
    check_noise(noise)
    if len(truth.places) != setting.num_frames:
        raise InputError(f"{len(truth.places)} frames of truth", field="truth", expected=f"{setting.num_frames} of the setting")
    if not 0 < truth.rate <= MAX_RATE:
        raise InputError(f"{truth.rate:g} frames a second", field=Argument("rate"), expected=f"above 0, at most {MAX_RATE:g}")
    with atomic_folder(path) as folder:
        write_cameras(folder / "Calib.toml", setting.cameras)
        write_places(folder / "truth.csv", truth.frames, truth.names, truth.places)
        (folder / "scene.toml").write_text(_describe(setting, truth, noise, lossless), encoding="utf-8")
        with Stage(setting) as stage:
            _write_empty(folder, setting, stage, noise)
            _write_frames(folder, setting, stage, noise, truth.rate, lossless, advance)
        besides(folder)


def _write_empty(folder: Path, setting: Setting, stage: Stage, noise: SensorNoise) -> None:
    for number, camera in enumerate(setting.cameras):
        plate = expose_long(stage.picture(number, person=False), noise, setting.seed, number)
        write_image(folder / f"{camera.name}_background.png", plate)
        write_image(folder / f"{camera.name}_occluder.png", stage.occluder(number))


def _write_frames(
    folder: Path,
    setting: Setting,
    stage: Stage,
    noise: SensorNoise,
    rate: float,
    lossless: bool,
    advance: Callable[[int], None],
) -> None:
    names = [camera.name for camera in setting.cameras]
    visible: dict[str, list[NDArray[np.uint8]]] = {name: [] for name in names}
    whole: dict[str, list[NDArray[np.uint8]]] = {name: [] for name in names}
    if lossless:
        for name in names:
            (folder / name).mkdir()
    with _videos(folder, names, rate) as videos:
        for frame in range(setting.num_frames):
            stage.pose(frame)
            for number, name in enumerate(names):
                picture = expose(stage.picture(number), noise, setting.seed, number, frame)
                videos[number].write(picture)
                if lossless:
                    write_image(folder / name / f"{frame:06d}.png", picture)
                seen = np.packbits(stage.visible(number), axis=-1)
                visible[name].append(seen)
                whole[name].append(np.packbits(stage.whole(number), axis=-1) if setting.furniture else seen)
            advance(1)
    for name in names:
        write_masks(folder / f"{name}_visible.npz", visible[name], setting.size)
        write_masks(folder / f"{name}_whole.npz", whole[name], setting.size)


@contextmanager
def _videos(folder: Path, names: Sequence[str], rate: float) -> Iterator[list[VideoWriter]]:
    with ExitStack() as stack:
        videos = [stack.enter_context(video_writer(folder / f"{name}.mp4", rate)) for name in names]
        yield videos


def _describe(setting: Setting, truth: Truth, noise: SensorNoise, lossless: bool) -> str:
    """Describe a scene as TOML; lengths in mm, angles in radians."""
    room = setting.room
    lines = [
        f"source = {quoted(truth.source)}",
        f"frames = {truth.frames.tolist()}",
        f"rate = {float(truth.rate)!r}",
        f"seed = {setting.seed}",
        f"size = {list(setting.size)}",
        f"lossless = {str(lossless).lower()}",
        f"clutter = {str(bool(setting.furniture)).lower()}",
        "",
        "[noise]  # fractions of white, of the gain, of the light",
        *(f"{name} = {float(value)!r}" for name, value in noise._asdict().items()),
        "",
        "[room]  # mm",
        f"centre = {room.centre.tolist()}",
        f"size = {room.size.tolist()}",
        f"floor = {float(room.floor)!r}",
    ]
    for piece in setting.furniture:
        lines += ["", "[[furniture]]  # mm, radians", f'kind = "{piece.kind}"']
        lines += [f"place = [{piece.x!r}, {piece.y!r}]", f"angle = {piece.angle!r}"]
    return "\n".join(lines) + "\n"
