"""Masks as packed bits in .npz files."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from poseppl.errors import InputError

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
