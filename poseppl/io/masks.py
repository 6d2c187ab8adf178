"""Foreground masks of one camera over time: packed bits in .npz files, or whatever a video can be read from."""

from __future__ import annotations

from collections.abc import Iterator
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from poseppl.errors import InputError
from poseppl.io.opencv import Image, to_rgb
from poseppl.io.video import Video, digest_of_files, open_video

Mask = NDArray[np.bool_]


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
    packed, (_, _, width) = _read_packed(path)
    return np.unpackbits(packed, axis=-1, count=width).astype(np.bool_)


def open_masks(path: str | PathLike[str], camera: str = "camera") -> Video:
    """Open masks as a video, white on the person.

    Args:
        path: An .npz file as :func:`write_masks` writes it, or what :func:`~poseppl.io.open_video` opens.
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


def _read_packed(path: str | PathLike[str]) -> tuple[NDArray[np.uint8], tuple[int, int, int]]:
    """Packed bits, and T, H, W."""
    try:
        with Path(path).open("rb") as stream, np.load(stream, allow_pickle=False) as stored:
            packed, (count, height, width) = stored["masks"], (int(side) for side in stored["shape"])
        if packed.shape != (count, height, -(-width // 8)) or packed.dtype != np.uint8 or not packed.size:
            raise ValueError(f"masks of shape {packed.shape} and type {packed.dtype} are not {count} x {height} x {width} bits")
    except Exception as error:  # damaged bytes raise anything at all
        expected = "an .npz file with packed bits in masks and their shape (T, H, W) in shape"
        raise InputError(f"no masks: {error}", file=path, expected=expected) from error
    return packed, (count, height, width)
