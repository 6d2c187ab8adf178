"""Moving pictures of one camera: a video file, a folder or pattern of images, or arrays, all read as the same thing.

    video = open_video("front.mp4", camera="front")
    for image in video.images(start=100):     # (H, W, 3) RGB, uint8
        ...

Frames are numbered from 0. A frame that cannot be had is an error that names the camera and the frame, never a gap. One kind of
damage cannot be seen from here: decoders of MPEG-4 and H.264 conceal a broken block and hand out the repaired frame as good.
"""

from __future__ import annotations

import glob
import hashlib
import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

from poseppl.errors import FilePath, InputError, Location
from poseppl.files.bounded_reading import check_file
from poseppl.motion.io.opencv import Image, check_image, check_name, check_pixels, opencv, place, read_image, to_rgb

_Source = FilePath | Sequence[Image] | Image


class Video(NamedTuple):
    """The pictures of one camera.

    Attributes:
        camera: The camera's name.
        size: Width and height in pixels.
        num_frames: How many frames there are; None where the file does not say.
        rate: Frames a second; None where nobody has said.
        source: Source of the pictures, for messages.
        stream: From the first frame wanted to an iterator of images that ends where the frames do.
        digest: Computes the hash of the content.
    """

    camera: str
    size: tuple[int, int]
    num_frames: int | None
    rate: float | None
    source: str
    stream: Callable[[int], Iterator[Image]]
    digest: Callable[[], str]

    def images(self, start: int = 0, stop: int | None = None) -> Iterator[Image]:
        """Read the frames start, start + 1, ..., stop - 1.

        Args:
            start: The first frame.
            stop: The frame after the last one; None for all.

        Yields:
            (H, W, 3) RGB images of type uint8; a gray source has three equal channels.

        Raises:
            InputError: A frame cannot be decoded or has another size than the first, or there are fewer than asked for.
        """
        if start < 0 or (stop is not None and stop < start):
            raise place(self.camera).error(f"frames {start} to {stop}", "0 <= start <= stop")
        if self.num_frames is not None and max(start, stop or 0) > self.num_frames:
            self._too_few(max(start, stop or 0), self.num_frames)
        frame = start
        images = self.stream(start) if stop is None or stop > start else iter(())
        for image in images:
            if image.shape[1::-1] != self.size:
                problem = f"the image has {image.shape[1]} x {image.shape[0]} pixels"
                expected = f"{self.size[0]} x {self.size[1]}, as in the first frame"
                raise place(self.camera, frame, self.source).error(problem, expected)
            yield image
            frame += 1
            if frame == stop:
                return
        if stop is not None and frame < stop:
            self._too_few(stop, frame)

    def _too_few(self, wanted: int, found: int) -> None:
        problem = f"the video has {found} frames, {wanted} were asked for"
        raise place(self.camera, file=self.source).error(problem, f"frames 0 to {found - 1}")


def open_video(source: _Source, camera: str = "camera", *, rate: float | None = None) -> Video:
    """Open the pictures of a camera.

    Args:
        source: A video file; an image; a folder or a pattern (``cam1/*.png``) of images; or images as arrays,
            (T, H, W, 3), (T, H, W) or a sequence of them. Image files are taken in the order of the numbers in their names.
        camera: The camera's name, for messages and for reading several together.
        rate: Frames a second; overrides what the file says.

    Returns:
        The video; its first frame has been read.

    Raises:
        InputError: The source does not exist, holds no image, or its first frame cannot be decoded.
        PosepplError: OpenCV is not installed.
    """
    if rate is not None and not 0 < rate < 1e6:
        raise place(camera).error(f"a rate of {rate}", "frames a second, above 0")
    if not isinstance(source, str | PathLike):
        return _from_arrays(source, camera, rate)
    text = str(source)
    picture = Path(source).is_file() and Path(source).suffix.lower() in SUFFIXES
    if picture or Path(source).is_dir() or (glob.has_magic(text) and not Path(source).exists()):
        paths = [Path(source)] if picture else images_in(source, camera)
        first = read_image(paths[0], camera, 0)
        size, count = (first.shape[1], first.shape[0]), len(paths)

        def stream(start: int) -> Iterator[Image]:
            return (read_image(paths[frame], camera, frame) for frame in range(start, count))

        return Video(camera, size, count, rate, text, stream, lambda: digest_of_files(paths))
    check_file(source, max_bytes=MAX_VIDEO_BYTES)
    found = probe(text, camera)
    return Video(
        camera,
        found.size,
        found.num_frames,
        rate or found.rate,
        text,
        lambda start: read_video(text, camera, start, found),
        lambda: digest_of_files([Path(text)]),
    )


def _from_arrays(source: Sequence[Image] | Image, camera: str, rate: float | None) -> Video:
    images = list(source)
    if not images:
        raise place(camera).error("no image", "at least one")
    checked = [check_image(image, camera, frame) for frame, image in enumerate(images)]

    def stream(start: int) -> Iterator[Image]:
        for image in checked[start:]:
            yield image.copy() if image.ndim == 3 else to_rgb(image)

    def digest() -> str:
        state = hashlib.blake2b(digest_size=16)
        for image in checked:
            state.update(repr(image.shape).encode() + image.tobytes())
        return state.hexdigest()

    height, width = checked[0].shape[:2]
    return Video(camera, (width, height), len(checked), rate, "arrays", stream, digest)


def digest_of_files(paths: Sequence[Path]) -> str:
    """Hash of the contents of files, in this order."""
    state = hashlib.blake2b(digest_size=16)
    for path in paths:
        with path.open("rb") as stream:
            state.update(hashlib.file_digest(stream, hashlib.blake2b).digest())
    return state.hexdigest()


SUFFIXES = frozenset((".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".tiff", ".webp"))


def images_in(source: FilePath, camera: str) -> list[Path]:
    """List the images of a folder or of a pattern, in the order of the numbers in their names.

    Args:
        source: A folder, whose other files are passed over, or a pattern such as ``cam1/*.png``.
        camera: The camera, for messages.

    Returns:
        The paths.

    Raises:
        InputError: There is no image, a folder mixes several kinds, or a number is missing where the others are evenly spaced.
    """
    at = place(camera, file=source)
    if Path(source).is_dir():
        paths = [path for path in Path(source).glob("[!.]*") if path.suffix.lower() in SUFFIXES]
        kinds = sorted({path.suffix.lower() for path in paths})
        if len(kinds) > 1:
            expected = f"one kind; name it with a pattern, {Path(source) / ('*' + kinds[0])}"
            raise at.error(f"the folder has images of kinds {', '.join(kinds)}", expected)
    else:
        paths = [Path(name) for name in glob.glob(str(source)) if Path(name).is_file()]
    if not paths:
        raise at.error("no image", "files that end in " + ", ".join(sorted(SUFFIXES)))
    paths.sort(key=_natural_order)
    _check_numbers(source, camera, paths)
    return paths


def _natural_order(path: Path) -> list[tuple[int, int, str]]:
    parts = re.findall(r"\d+|\D+", path.name)
    return [(0, int(part), part) if part.isdecimal() else (1, 0, part) for part in parts]


def _check_numbers(source: FilePath, camera: str, paths: Sequence[Path]) -> None:
    found = [re.findall(r"\d+", path.stem) for path in paths]
    if len(paths) < 3 or not all(found):
        return
    numbers = [int(digits[-1]) for digits in found]
    steps = [after - before for before, after in zip(numbers, numbers[1:], strict=False)]
    step = min(steps)
    if step < 1:
        return
    for frame, (number, width) in enumerate(zip(numbers, steps, strict=False)):
        if width != step:
            problem = f"no image with the number {number + step}, after {paths[frame].name}"
            expected = f"evenly spaced numbers, {numbers[0]}, {numbers[0] + step}, ..."
            raise place(camera, frame + 1, source).error(problem, expected)


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
