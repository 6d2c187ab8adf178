"""Features of a whole video, each frame's computed once and kept in a folder.

A frame's file is ``FOLDER/KEY/000012.npz``; KEY is a hash of the video's content, the plate, the ignore mask, the
settings and OpenCV's version: whatever changes one of them finds another folder.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from poseppl.errors import FilePath, InputError
from poseppl.files.store import Arrays, Note, Store, key_of
from poseppl.motion.io.opencv import Image, opencv
from poseppl.motion.io.video import Video
from poseppl.motion.vision.background import Background, learn_background
from poseppl.motion.vision.features import BadMask, FeatureSettings, FrameFeatures, extract, scale_image
from poseppl.motion.vision.masks import Mask

VERSION = 3
"""Counted up when the same settings come to mean other features."""
_BYTES_PER_PIXEL, _ROOM = 64, 2**22
"""Bytes that the features of a frame may take, at most."""


def video_features(
    video: Video,
    settings: FeatureSettings | None = None,
    *,
    folder: FilePath | None = None,
    plate: Image | None = None,
    ignore: Mask | None = None,
    occlusion: Mask | None = None,
    start: int = 0,
    stop: int | None = None,
    bad_mask: BadMask = "raise",
    note: Note = lambda message: None,
) -> Iterator[FrameFeatures]:
    """Take the features of a video's frames, or read them where they are kept.

    Args:
        video: The video.
        settings: The settings; None for the default ones.
        folder: Folder of stored features, created if it does not exist; None stores nothing.
        plate: (H, W, 3) picture of the empty scene, of the video's size; None learns the background from the whole video.
        ignore: (H, W) of the video's size, not 0 at pixels that give no evidence; None for none.
        occlusion: (H, W) of the video's size, not 0 where furniture may stand before the person, as in ``extract``.
        start: The first frame.
        stop: The frame after the last; None for all.
        bad_mask: Treatment of a foreground that is (nearly) empty or full, as in ``extract``.
        note: Receives a message about stored features that are damaged; they are computed again.

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
    key = None if folder is None else feature_key(video, chosen, plate, ignore, occlusion, bad_mask)
    room = _ROOM + _BYTES_PER_PIXEL * math.prod(video.size)
    store = None if folder is None else Store(Path(folder) / str(key), "features", note, max_unpacked=room)
    background: Background | None = None
    frames = _Frames(video)
    end = stop if stop is not None else video.num_frames
    frame = start
    while end is None or frame < end:
        name = f"{frame:06d}"
        features = store.load(name, {"key": key}, partial(restored_features, settings=chosen)) if store else None
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
                ignore=ignore,
                occlusion=occlusion,
                camera=video.camera,
                frame=frame,
                bad_mask=bad_mask,
            )
            if store:
                store.save(name, features._asdict(), {"key": key})
        yield features
        frame += 1


def feature_key(
    video: Video,
    settings: FeatureSettings,
    plate: Image | None,
    ignore: Mask | None,
    occlusion: Mask | None = None,
    bad_mask: BadMask = "raise",
) -> str:
    """Hash all that a video's features depend on.

    Args:
        video: The video; its content is hashed, not its name.
        settings: The settings.
        plate: The picture of the empty scene, if there is one.
        ignore: The ignore mask, if there is one.
        occlusion: The occlusion mask, if there is one.
        bad_mask: Treatment of an empty or a full foreground.

    Returns:
        64 hexadecimal digits.
    """
    made_of = {
        "version": VERSION,
        "opencv": opencv().__version__,
        "video": video.digest(),
        "settings": repr(settings),
        "bad_mask": bad_mask,
    }
    return key_of(made_of, [plate, ignore, occlusion])


def restored_features(arrays: Arrays, settings: FeatureSettings) -> FrameFeatures:
    """Features of a frame, from arrays that were kept.

    Args:
        arrays: The arrays by name.
        settings: Settings of their computation.

    Raises:
        KeyError, ValueError: They are no features, or those of other settings.
    """
    features = FrameFeatures(**{name: arrays[name] for name in FrameFeatures._fields})
    expected = [features.foreground.shape] * 6 + [(settings.colour.bins,), (settings.descriptors,)]
    if [array.shape for array in (*features[:6], features.histogram, features.descriptors)] != expected:
        raise ValueError("arrays of other shapes")
    return features


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
