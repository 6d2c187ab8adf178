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
from collections.abc import Callable, Iterator, Sequence
from os import PathLike
from pathlib import Path
from typing import NamedTuple

from poseppl.errors import FilePath
from poseppl.files.bounded_reading import check_file
from poseppl.motion.io.image_sequence import SUFFIXES, images_in
from poseppl.motion.io.opencv import Image, check_image, place, read_image, to_rgb
from poseppl.motion.io.video_decoding import MAX_VIDEO_BYTES, probe, read_video

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
