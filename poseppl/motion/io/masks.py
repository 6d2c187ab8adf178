"""Foreground masks of one camera over time: packed bits in .npz files, or whatever a video can be read from."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from poseppl.errors import FilePath, Location, cut
from poseppl.files.bounded_reading import check_file
from poseppl.files.numpy_arrays import part_header, read_part
from poseppl.motion.io.opencv import Image, to_rgb
from poseppl.motion.io.video import Video, digest_of_files, open_video

Mask = NDArray[np.bool_]
MAX_BYTES = 4 * 2**30
"""Largest size of packed masks: 16,000 frames of 1920 x 1080."""


def write_masks(path: Path, masks: list[NDArray[np.uint8]], size: tuple[int, int]) -> None:
    """Write masks that ``numpy.packbits`` has packed along their rows.

    Args:
        path: The .npz file: ``masks`` (T, H, ceil(W / 8)), ``shape`` (T, H, W).
        masks: T packed masks.
        size: W and H.
    """
    with path.open("wb") as stream:
        np.savez_compressed(stream, masks=np.stack(masks), shape=np.array([len(masks), size[1], size[0]]))


def read_masks(path: FilePath) -> Mask:
    """Read masks (T, H, W) back.

    Raises:
        InputError: The file is missing or holds no such masks.
    """
    packed, (_, _, width) = _read_packed(path)
    return np.unpackbits(packed, axis=-1, count=width).astype(np.bool_)


def open_masks(path: FilePath, camera: str = "camera") -> Video:
    """Open masks as a video, white on the person.

    Args:
        path: An .npz file as :func:`write_masks` writes it, or what :func:`~poseppl.motion.io.open_video` opens.
        camera: Name of the video.

    Raises:
        InputError: It cannot be read.
    """
    if Path(path).suffix.lower() != ".npz":
        return open_video(path, camera)
    packed, (count, height, width) = _read_packed(path)

    def stream(start: int) -> Iterator[Image]:
        for bits in packed[start:]:
            yield to_rgb(np.unpackbits(bits, axis=-1, count=width) * np.uint8(255))

    return Video(camera, (width, height), count, None, str(path), stream, lambda: digest_of_files([Path(path)]))


def _read_packed(path: FilePath) -> tuple[NDArray[np.uint8], tuple[int, int, int]]:
    """Packed bits, and T, H, W; what the headers of the file's parts declare is checked before the parts are read."""
    source = check_file(path, max_bytes=MAX_BYTES)
    try:
        with zipfile.ZipFile(source) as archive:
            kind, declared = part_header(archive, "shape.npy")
            if declared != (3,) or kind.kind not in "iu":
                raise ValueError(f"a shape of type {kind} and {declared} numbers")
            count, height, width = (int(side) for side in read_part(archive, "shape.npy", 1024))
            if not (0 < count < 2**31 and 0 < height < 2**16 and 0 < width < 2**16):
                raise ValueError(f"{count} masks of {width} x {height}")
            kind, declared = part_header(archive, "masks.npy")
            if declared != (count, height, -(-width // 8)) or kind != np.uint8:
                raise ValueError(f"masks of shape {declared} and type {kind} are not {count} x {height} x {width} bits")
            return read_part(archive, "masks.npy", MAX_BYTES), (count, height, width)
    except Exception as error:  # damaged bytes bring about anything
        expected = "an .npz file with packed bits in masks and their shape (T, H, W) in shape"
        reason = str(error).strip().splitlines() or [type(error).__name__]
        raise Location(path).error(f"no masks: {cut(reason[0], 200)}", expected) from error
