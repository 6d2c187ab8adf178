"""Features of a whole video, each frame's computed once and kept in a folder.

A frame's file is ``FOLDER/KEY/000012.npz``; KEY is a hash of the video's content, the plate, the mask of unknown pixels, the
settings and OpenCV's version: whatever changes one of them finds another folder. A file that is broken is computed again.
"""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Iterator
from os import PathLike
from pathlib import Path

import numpy as np

from poseppl.errors import InputError
from poseppl.files.atomic_writing import atomic_path
from poseppl.motion.io.opencv import Image, opencv
from poseppl.motion.io.video import Video
from poseppl.motion.vision.background import Background, learn_background
from poseppl.motion.vision.features import BadMask, FeatureSettings, FrameFeatures, extract, scale_image
from poseppl.motion.vision.masks import Mask

VERSION = 1
"""Counted up when the same settings come to mean other features."""


def video_features(
    video: Video,
    settings: FeatureSettings | None = None,
    *,
    folder: str | PathLike[str] | None = None,
    plate: Image | None = None,
    unknown: Mask | None = None,
    start: int = 0,
    stop: int | None = None,
    bad_mask: BadMask = "raise",
) -> Iterator[FrameFeatures]:
    """Take the features of a video's frames, or read them where they are kept.

    Args:
        video: The video.
        settings: The settings; None for the default ones.
        folder: Where features are kept, made if need be; None keeps nothing.
        plate: (H, W, 3) picture of the empty scene, of the video's size; None learns the background from the whole video.
        unknown: (H, W) of the video's size, not 0 at pixels that give no evidence; None for none.
        start: The first frame.
        stop: The frame after the last; None for all.
        bad_mask: What to do with a foreground that is (nearly) empty or full, as in ``extract``.

    Yields:
        The features of the frames start, start + 1, ..., stop - 1.

    Raises:
        InputError: A frame cannot be read, its foreground is empty or full, or the folder cannot be written.
        ValueError: A setting is out of its range, or the background adapts (its ``learning_rate`` is above 0): a frame's
            features would depend on the frames asked for before.
    """
    chosen = (settings or FeatureSettings()).check()
    if chosen.background.learning_rate > 0:
        raise ValueError("background.learning_rate is above 0. Expected 0 where features are taken of a video; use extract.")
    kept = None if folder is None else _made(Path(folder) / feature_key(video, chosen, plate, unknown, bad_mask))
    background: Background | None = None
    frames = _Frames(video)
    end = stop if stop is not None else video.num_frames
    frame = start
    while end is None or frame < end:
        path = None if kept is None else kept / f"{frame:06d}.npz"
        features = None if path is None else read_features(path, chosen)
        if features is None:
            image = frames.image(frame, optional=stop is None)
            if image is None:
                return
            if background is None:
                pictures = video.images() if plate is None else iter([plate])
                background = learn_background((scale_image(picture, chosen.scale) for picture in pictures), chosen.background)
            before = frames.image(frame - 1) if frame > 0 and chosen.flow is not None else None
            features = extract(
                image,
                background,
                chosen,
                previous=before,
                unknown=unknown,
                camera=video.camera,
                frame=frame,
                bad_mask=bad_mask,
            )
            if path is not None:
                write_features(path, features)
        yield features
        frame += 1


def feature_key(
    video: Video, settings: FeatureSettings, plate: Image | None, unknown: Mask | None, bad_mask: BadMask = "raise"
) -> str:
    """Hash all that a video's features depend on.

    Args:
        video: The video; its content is hashed, not its name.
        settings: The settings.
        plate: The picture of the empty scene, if there is one.
        unknown: The mask of unknown pixels, if there is one.
        bad_mask: What is done with an empty or a full foreground.

    Returns:
        32 hexadecimal digits.
    """
    state = hashlib.blake2b(digest_size=16)
    state.update(repr((VERSION, opencv().__version__, video.digest(), settings, bad_mask)).encode())
    for array in (plate, unknown):
        state.update(b"none" if array is None else repr((array.shape, array.dtype)).encode() + array.tobytes())
    return state.hexdigest()


def write_features(path: str | PathLike[str], features: FrameFeatures) -> None:
    """Write the features of a frame as a compressed .npz, whole or not at all.

    Args:
        path: The file.
        features: The features.

    Raises:
        InputError: The file cannot be written.
        PosepplError: The disk is full.
    """
    with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, array in features._asdict().items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as stream:
                np.lib.format.write_array(stream, array, allow_pickle=False)


def read_features(path: str | PathLike[str], settings: FeatureSettings) -> FrameFeatures | None:
    """Read the features of a frame.

    Args:
        path: The file.
        settings: What they were taken with.

    Returns:
        The features; None where there is no such file, or it is broken.
    """
    try:
        with Path(path).open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
            features = FrameFeatures(**{name: archive[name] for name in FrameFeatures._fields})
    except Exception:  # damaged bytes raise anything at all
        return None
    shape = features.foreground.shape
    maps = features[:6]
    whole = all(plane.shape == shape for plane in maps) and features.histogram.shape == (settings.colour.bins,)
    return features if whole and features.descriptors.shape == (settings.descriptors,) else None


class _Frames:
    """Frames by number, read on from the last one asked for, which is still at hand."""

    def __init__(self, video: Video) -> None:
        self._video = video
        self._stream: Iterator[Image] = iter(())
        self._next = -1
        self._recent: dict[int, Image] = {}

    def image(self, frame: int, optional: bool = False) -> Image | None:
        if frame in self._recent:
            return self._recent[frame]
        if frame != self._next:
            self._next = max(frame - 1, 0)
            self._stream = self._video.images(self._next)
        while self._next <= frame:
            image = next(self._stream, None)
            if image is None:
                if optional:
                    return None
                problem = f"the video ends before frame {frame}"
                raise InputError(problem, file=self._video.source, field=f"camera {self._video.camera}, frame {frame}")
            self._recent = {number: kept for number, kept in self._recent.items() if number == self._next - 1}
            self._recent[self._next] = image
            self._next += 1
        return self._recent[frame]


def _made(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"the folder cannot be made: {error.strerror}", file=folder) from error
    return folder
