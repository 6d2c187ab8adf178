"""Files of pictures: PNG, MPEG-4 video, and masks as packed bits. Every one is checked to be whole."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseppl.errors import InputError, PosepplError
from poseppl.rendering.packages import load_opencv

Pixels = NDArray[np.uint8]
Mask = NDArray[np.bool_]


def write_png(path: Path, image: Pixels | Mask) -> None:
    """Write an image (H, W, 3) of red, green and blue, or a mask (H, W), true as white."""
    pixels = image[..., ::-1] if image.ndim == 3 else image.astype(np.uint8) * 255
    done, data = load_opencv().imencode(".png", np.ascontiguousarray(pixels))
    if not done:
        raise PosepplError(f"{path}: OpenCV could not encode the image")
    path.write_bytes(bytes(data))


class Video:
    """An MPEG-4 video that is written frame by frame, and lossy: a few grey levels. Use it in a ``with`` block.

    Args:
        path: The .mp4 file.
        size: Width and height in pixels, even numbers.
        rate: Frames a second.

    Raises:
        PosepplError: OpenCV has no encoder; on leaving the block, the file does not hold all frames.
    """

    def __init__(self, path: Path, size: tuple[int, int], rate: float) -> None:
        self._cv2 = load_opencv()
        self._path, self._count = path, 0
        self._writer: Any = self._cv2.VideoWriter(str(path), self._cv2.VideoWriter_fourcc(*"mp4v"), rate, size)
        if not self._writer.isOpened():
            raise PosepplError(f"{path.name}: OpenCV has no MPEG-4 encoder here; pip install opencv-python-headless has one")

    def __enter__(self) -> Video:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self._writer.release()
        if error is None:
            self._check()

    def write(self, image: Pixels) -> None:
        """Add a frame (H, W, 3) of red, green and blue."""
        self._writer.write(np.ascontiguousarray(image[..., ::-1]))
        self._count += 1

    def _check(self) -> None:
        """Count the frames of the finished file: the encoder does not tell when the disk is full."""
        reader = self._cv2.VideoCapture(str(self._path))
        found = int(reader.get(self._cv2.CAP_PROP_FRAME_COUNT)) if reader.isOpened() else 0
        reader.release()
        if found != self._count:
            raise PosepplError(f"{self._path.name}: {found} of {self._count} frames were written; is the disk full?")


def write_masks(path: Path, masks: list[NDArray[np.uint8]], size: tuple[int, int]) -> None:
    """Write masks that :func:`pack_mask` has packed.

    Args:
        path: The .npz file: ``masks`` (T, H, ceil(W / 8)) as numpy.packbits has them along a row, ``shape`` (T, H, W).
        masks: T packed masks.
        size: W and H.
    """
    with path.open("wb") as stream:
        np.savez_compressed(stream, masks=np.stack(masks), shape=np.array([len(masks), size[1], size[0]]))


def pack_mask(mask: Mask) -> NDArray[np.uint8]:
    """Pack a mask (H, W) into bits along its rows."""
    return np.packbits(mask, axis=-1)


def read_masks(path: str | PathLike[str]) -> Mask:
    """Read masks (T, H, W) back.

    Raises:
        InputError: The file is missing or holds no such masks.
    """
    try:
        with np.load(path) as stored:
            packed, shape = stored["masks"], tuple(int(side) for side in stored["shape"])
        masks = np.unpackbits(packed, axis=-1, count=shape[-1])
        if masks.shape != shape:
            raise ValueError(f"{masks.shape} is not {shape}")
    except (OSError, KeyError, ValueError, IndexError, TypeError) as error:
        expected = "an .npz file with packed bits in masks and their shape (T, H, W) in shape"
        raise InputError(f"no masks: {error}", file=path, expected=expected) from error
    return masks.astype(np.bool_)
