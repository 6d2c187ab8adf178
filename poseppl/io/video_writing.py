"""Writing of videos, whole or not at all."""

from __future__ import annotations

from collections.abc import Iterable
from os import PathLike
from pathlib import Path

from poseppl.errors import InputError, PosepplError
from poseppl.io.files import atomic_path
from poseppl.io.opencv import Image, check_image, opencv

SUFFIXES = (".mp4", ".avi", ".mkv")


def write_video(path: str | PathLike[str], images: Iterable[Image], rate: float, *, codec: str = "mp4v") -> int:
    """Write images as a video.

    The images are encoded under a temporary name; the file is opened again and counted before it gets its own.

    Args:
        path: The file, .mp4, .avi or .mkv.
        images: (H, W, 3) RGB or (H, W) gray, all of one size, H and W even; taken one at a time.
        rate: Frames a second.
        codec: OpenCV's four letters. "mp4v", MPEG-4 part 2, is in every build; "avc1", H.264, is not.

    Returns:
        The number of frames written.

    Raises:
        InputError: There is no image, an image is malformed or of another or an odd size, or the file cannot be written.
        PosepplError: OpenCV is not installed, has no such encoder, or the disk is full.
    """
    cv2 = opencv()
    if Path(path).suffix.lower() not in SUFFIXES:
        raise InputError("unknown kind of video", file=path, expected="a name that ends in " + ", ".join(SUFFIXES))
    if len(codec) != 4 or not 0 < rate < 1e6:
        raise InputError(f"rate {rate}, codec {codec!r}", file=path, expected="frames a second above 0, and four letters")
    with atomic_path(path) as temporary:
        writer, size, count = cv2.VideoWriter(), (0, 0), 0
        try:
            for image in images:
                checked = check_image(image, None, count)
                if count == 0:
                    size = checked.shape[1::-1]
                    if size[0] % 2 or size[1] % 2:  # OpenCV would cut off the last column or row
                        problem = f"images of {size[0]} x {size[1]} pixels"
                        raise InputError(problem, file=path, expected="an even width and height; crop or pad by one pixel")
                    if not writer.open(str(temporary), cv2.VideoWriter.fourcc(*codec), float(rate), size):
                        raise PosepplError(f"{path}: this OpenCV cannot encode {codec!r} into it; try codec='mp4v'")
                elif checked.shape[1::-1] != size:
                    problem = f"the image has {checked.shape[1]} x {checked.shape[0]} pixels"
                    raise InputError(problem, file=path, field=f"frame {count}", expected=f"{size[0]} x {size[1]}")
                writer.write(cv2.cvtColor(checked, cv2.COLOR_GRAY2BGR if checked.ndim == 2 else cv2.COLOR_RGB2BGR))
                count += 1
        finally:
            writer.release()
        if count == 0:
            raise InputError("no image to write", file=path, expected="at least one")
        _check_written(path, temporary, count)
    return count


def _check_written(path: str | PathLike[str], temporary: Path, count: int) -> None:
    # The encoder reports neither a full disk nor a frame that it dropped.
    cv2 = opencv()
    capture = cv2.VideoCapture(str(temporary))
    found = int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) if capture.isOpened() else 0
    capture.release()
    if found != count:
        raise PosepplError(f"{path}: {found} of {count} frames were written (is the disk full?); nothing was kept")
