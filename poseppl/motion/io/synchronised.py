"""Several cameras read together, frame by frame."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from typing import Literal

from poseppl.errors import InputError, brief
from poseppl.motion.io.opencv import Image, place
from poseppl.motion.io.video import Video

RATE_TOLERANCE = 1e-4
"""Relative difference up to which two rates count as one: a slip of a frame in 10,000, above the rounding in headers."""
Mismatch = Literal["raise", "shortest"]


class VideoWarning(UserWarning):
    """Cameras differ, and the caller chose to go on."""


def synchronised(
    videos: Sequence[Video], *, start: int = 0, stop: int | None = None, mismatch: Mismatch = "raise"
) -> Iterator[tuple[int, dict[str, Image]]]:
    """Read the same frames of several cameras.

    Frame t of one camera goes with frame t of every other: the cameras must have been started together and run at one rate.

    Args:
        videos: The cameras, each with a name of its own.
        start: The first frame.
        stop: The frame after the last; None for all.
        mismatch: Action if cameras differ in length or rate: "raise", or "shortest", which ends with the shortest one and
            reports each difference as a ``VideoWarning``.

    Yields:
        The frame number, and the image of each camera by its name.

    Raises:
        InputError: Two cameras share a name, their lengths or rates differ, or a frame cannot be decoded.
    """
    end = _check(videos, stop, mismatch)
    streams = {video.camera: video.images(start, end) for video in videos}
    frame = start
    while end is None or frame < end:
        images = {camera: next(stream, None) for camera, stream in streams.items()}
        ended = [camera for camera, image in images.items() if image is None]
        if ended:
            if len(ended) < len(videos):
                _report(f"the video ends before frame {frame}, other cameras continue", ended[0], mismatch)
            return
        yield frame, {camera: image for camera, image in images.items() if image is not None}
        frame += 1


def _check(videos: Sequence[Video], stop: int | None, mismatch: Mismatch) -> int | None:
    names = [video.camera for video in videos]
    repeated = [name for name in names if names.count(name) > 1]
    if not videos or repeated:
        problem = f"two videos of the camera {brief(repeated[0])}" if repeated else "no camera"
        raise InputError(problem, expected="at least one camera, each with a name of its own")
    rates = [(video.rate, video.camera) for video in videos if video.rate is not None]
    for rate, camera in rates[1:]:
        if abs(rate / rates[0][0] - 1.0) > RATE_TOLERANCE:
            problem = f"{rate:g} frames a second, but {rates[0][0]:g} in camera {rates[0][1]}; frames are paired by number"
            _report(problem, camera, mismatch)
    lengths = [video.num_frames for video in videos if video.num_frames is not None]
    if not lengths:
        return stop
    shortest = min(lengths)
    if stop is not None and stop <= shortest:
        return stop
    if stop is not None or max(lengths) > shortest:
        camera = next(video.camera for video in videos if video.num_frames == shortest)
        wanted = stop if stop is not None else max(lengths)
        _report(f"the video has {shortest} frames, {wanted} are wanted", camera, mismatch)
    return shortest if len(lengths) == len(videos) or stop is not None else None


def _report(problem: str, camera: str, mismatch: Mismatch) -> None:
    if mismatch == "raise":
        expected = "cameras of one length and rate; or mismatch='shortest', to end with the shortest"
        raise place(camera).error(problem, expected)
    warnings.warn(f"{place(camera).field}: {problem}", VideoWarning, stacklevel=4)
