"""Decoding of video files through OpenCV, with a look at the time stamps: decoders pass over a broken frame in silence."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from poseppl.errors import InputError, Location
from poseppl.motion.io.opencv import Image, check_name, check_pixels, opencv, place, to_rgb

MAX_VIDEO_BYTES = 2**44
GAP = 1.75
"""Frame intervals between time stamps from which a frame counts as left out; between even stamps there is 1."""
_FORMATS = ",".join(
    ["mov", "mp4", "m4v", "matroska", "webm", "avi", "mpeg", "mpegts", "mpegvideo", "flv", "asf", "ogg", "mxf", "dv", "gif"]
    + ["nut", "ivf", "h264", "hevc", "mjpeg", "yuv4mpegpipe"]
)
"""FFmpeg's names of files that hold their pictures; playlists and the like name other files and servers."""


class VideoFacts(NamedTuple):
    """Facts in a video file's header.

    Attributes:
        size: Width and height in pixels, as decoded (a rotation in the header is applied).
        num_frames: Frames that the header promises; None where it does not.
        rate: Frames a second; None where the header does not say.
    """

    size: tuple[int, int]
    num_frames: int | None
    rate: float | None


def probe(path: str, camera: str) -> VideoFacts:
    """Decode the first frame of a video file.

    Args:
        path: The file, which exists.
        camera: The camera, for messages.

    Returns:
        The properties that the file states.

    Raises:
        InputError: Its first frame cannot be decoded.
    """
    cv2 = opencv()
    with _capture(path, camera) as capture:
        count, rate = capture.get(cv2.CAP_PROP_FRAME_COUNT), capture.get(cv2.CAP_PROP_FPS)
        done, image = capture.read()
    if not done:
        raise _undecodable(place(camera, 0, path))
    known = 0 < count < 2**40
    return VideoFacts((image.shape[1], image.shape[0]), int(count) if known else None, rate if 0 < rate < 1e6 else None)


def read_video(path: str, camera: str, start: int, facts: VideoFacts) -> Iterator[Image]:
    """Decode the frames of a video file from one on to its end.

    Args:
        path: The file.
        camera: The camera, for messages.
        start: The first frame.
        facts: Properties that the file states.

    Yields:
        (H, W, 3) RGB images.

    Raises:
        InputError: A frame cannot be decoded, is left out, or frames that the header promises are not there.
    """
    cv2 = opencv()
    frame, before = start, None
    with _capture(path, camera) as capture:
        _seek(path, camera, capture, start)
        while True:
            done, image = capture.read()
            if not done:
                break
            now = capture.get(cv2.CAP_PROP_POS_MSEC)
            intervals = 1.0 if before is None or facts.rate is None else (now - before) * facts.rate / 1000.0
            if intervals > GAP:
                problem = f"cannot be decoded, or is left out: time goes on from {before:.0f} to {now:.0f} ms"
                rate = facts.rate or 25.0
                expected = f"one frame every {1000.0 / rate:.1f} ms; make it so: ffmpeg -i {path} -r {rate:g} new.mp4"
                raise place(camera, frame, path).error(problem, expected)
            yield to_rgb(image)
            frame, before = frame + 1, now
    if facts.num_frames is not None and frame < facts.num_frames:
        problem = f"cannot be decoded, or the file is cut off: its header promises {facts.num_frames} frames"
        raise place(camera, frame, path).error(problem, f"a whole file; or read with stop={frame}")


@contextmanager
def _capture(path: str, camera: str) -> Iterator[Any]:
    cv2 = opencv()
    os.environ.setdefault("OPENCV_FFMPEG_CAPTURE_OPTIONS", f"format_whitelist;{_FORMATS}")
    capture = cv2.VideoCapture(check_name(path))
    try:
        if not capture.isOpened():
            raise _undecodable(place(camera, file=path))
        size = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        check_pixels(size, place(camera, file=path))
        yield capture
    finally:
        capture.release()


def _seek(path: str, camera: str, capture: Any, start: int) -> None:
    # Going through all frames instead of jumping costs their decoding, and finds the same frame in every container.
    for frame in range(start):
        if not capture.grab():
            raise _undecodable(place(camera, frame, path), ", or the video ends before it")


def _undecodable(at: Location, besides: str = "") -> InputError:
    expected = f"a whole video that OpenCV's FFmpeg reads; convert it: ffmpeg -i {at.file} -c:v libx264 new.mp4"
    return at.error(f"cannot be decoded{besides}", expected)
