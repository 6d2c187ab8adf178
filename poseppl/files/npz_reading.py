"""Arrays of .npz files: what the parts declare is compared with the file before any of it is unpacked."""

from __future__ import annotations

import math
import zipfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

SUFFIX = ".npy"


def part_header(archive: zipfile.ZipFile, part: str) -> tuple[np.dtype[Any], tuple[int, ...]]:
    """Type and shape that a part declares.

    Raises:
        ValueError: They do not take the bytes that the part has, or the array is pickled.
    """
    with archive.open(part) as stream:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, kind = read(stream)
        if kind.hasobject or stream.tell() + math.prod(shape) * kind.itemsize != archive.getinfo(part).file_size:
            raise ValueError(f"{part} does not contain the array that it declares")
    return kind, shape


def read_part(archive: zipfile.ZipFile, part: str, max_bytes: int) -> NDArray[Any]:
    """Read the array of a part.

    Args:
        archive: The file.
        part: Name of the part, with its suffix.
        max_bytes: The most that it may take when unpacked.

    Raises:
        ValueError: It declares more, or is damaged.
    """
    size = archive.getinfo(part).file_size
    if size > max_bytes:
        raise ValueError(f"{part} declares {size / 2**20:.1f} MiB, at most {max_bytes / 2**20:.1f} are read")
    part_header(archive, part)
    with archive.open(part) as stream:
        array: NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False)
        stream.read(1)  # at the end the sum is checked
    return array


def read_parts(archive: zipfile.ZipFile, max_bytes: int) -> dict[str, NDArray[Any]]:
    """Read all arrays by name.

    Args:
        archive: The file.
        max_bytes: The most that they may take together when unpacked.

    Raises:
        ValueError: They declare more, or one is damaged.
    """
    total = sum(info.file_size for info in archive.infolist())
    if total > max_bytes:
        raise ValueError(f"it declares {total / 2**20:.1f} MiB, at most {max_bytes / 2**20:.1f} are read")
    return {part.removesuffix(SUFFIX): read_part(archive, part, max_bytes) for part in archive.namelist()}
