"""Writing of videos, whole or not at all."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from poseppl.errors import FilePath, Location, PosepplError, brief
from poseppl.files.atomic_writing import atomic_path
from poseppl.motion.io.opencv import Image, check_image, check_name, opencv

SUFFIXES = (".mp4", ".avi", ".mkv")


class VideoWriter:
    """Takes the frames of a video one by one; :func:`video_writer` makes it.

    Args:
        path: The file, for messages.
        temporary: File to which it is encoded.
        rate: Frames a second.
        codec: OpenCV's four letters.

    Attributes:
        count: The number of frames so far.
    """

    def __init__(self, path: FilePath, temporary: Path, rate: float, codec: str) -> None:
        self._writer = opencv().VideoWriter()
        self._at, self._temporary, self._rate, self._codec = Location(path), temporary, rate, codec
        self._size, self.count = (0, 0), 0

    def write(self, image: Image) -> None:
        """Add a frame.

        Args:
            image: (H, W, 3) RGB or (H, W) gray, of the first one's size, H and W even.

        Raises:
            InputError: The image is malformed, or of another or an odd size.
            PosepplError: OpenCV has no such encoder.
        """
        cv2, checked = opencv(), check_image(image, None, self.count)
        if self.count == 0:
            self._open(checked.shape[1], checked.shape[0])
        elif checked.shape[1::-1] != self._size:
            problem = f"the image has {checked.shape[1]} x {checked.shape[0]} pixels"
            raise self._at.in_field(f"frame {self.count}").error(problem, f"{self._size[0]} x {self._size[1]}")
        self._writer.write(cv2.cvtColor(checked, cv2.COLOR_GRAY2BGR if checked.ndim == 2 else cv2.COLOR_RGB2BGR))
        self.count += 1

    def release(self) -> None:
        """Close the file, finished or not."""
        self._writer.release()

    def check(self) -> None:
        """Count the frames of the closed file: the encoder reports neither a full disk nor a frame that it dropped.

        Raises:
            InputError: No frame was written.
            PosepplError: There are fewer than were written.
        """
        if self.count == 0:
            raise self._at.error("no image to write", "at least one")
        cv2 = opencv()
        capture = cv2.VideoCapture(str(self._temporary))
        found = int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) if capture.isOpened() else 0
        capture.release()
        if found != self.count:
            message = f"{found} of {self.count} frames were written (is the disk full?); nothing was kept"
            raise PosepplError(f"{self._at.file}: {message}")

    def _open(self, width: int, height: int) -> None:
        if width % 2 or height % 2:  # OpenCV would cut off the last column or row
            raise self._at.error(f"images of {width} x {height} pixels", "an even width and height; crop or pad by one pixel")
        code = opencv().VideoWriter.fourcc(*self._codec)
        if not self._writer.open(check_name(self._temporary), code, float(self._rate), (width, height)):
            raise PosepplError(f"{self._at.file}: this OpenCV cannot encode {brief(self._codec)} into it; try codec='mp4v'")
        self._size = (width, height)


@contextmanager
def video_writer(path: FilePath, rate: float, *, codec: str = "mp4v") -> Iterator[VideoWriter]:
    """Write a video frame by frame, whole or not at all, in a ``with`` block.

    The images are encoded under a temporary name; the file is opened again and counted before it gets its own.

    Args:
        path: The file, .mp4, .avi or .mkv.
        rate: Frames a second.
        codec: OpenCV's four letters. "mp4v", MPEG-4 part 2, is in every build; "avc1", H.264, is not.

    Yields:
        A function that takes the frames.

    Raises:
        InputError: There is no image, or the file cannot be written.
        PosepplError: OpenCV is not installed, or the disk is full.
    """
    if Path(path).suffix.lower() not in SUFFIXES:
        raise Location(path).error("unknown kind of video", "a name that ends in " + ", ".join(SUFFIXES))
    if len(codec) != 4 or not 0 < rate < 1e6:
        raise Location(path).error(f"rate {rate}, codec {brief(codec)}", "frames a second above 0, and four letters")
    with atomic_path(path) as temporary:
        writer = VideoWriter(path, temporary, rate, codec)
        try:
            yield writer
        finally:
            writer.release()
        writer.check()


def write_video(path: FilePath, images: Iterable[Image], rate: float, *, codec: str = "mp4v") -> int:
    """Write images as a video, whole or not at all.

    Args:
        path: The file, .mp4, .avi or .mkv.
        images: (H, W, 3) RGB or (H, W) gray, all of one size, H and W even; taken one at a time.
        rate: Frames a second.
        codec: As :func:`video_writer` has it.

    Returns:
        The number of frames written.

    Raises:
        InputError: There is no image, an image is malformed or of another or an odd size, or the file cannot be written.
        PosepplError: OpenCV is not installed, has no such encoder, or the disk is full.
    """
    with video_writer(path, rate, codec=codec) as writer:
        for image in images:
            writer.write(image)
    return writer.count
