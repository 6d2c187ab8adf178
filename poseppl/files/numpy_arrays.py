"""Arrays of .npz and .npy files: what the header declares is checked before any value is unpacked."""

from __future__ import annotations

import math
import zipfile
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from poseppl.errors import FilePath, Location
from poseppl.files.bounded_reading import check_file

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


_MAX_HEADER = 1000


def read_array(path: FilePath, *, max_values: int) -> NDArray[Any]:
    """Read an array of floating-point numbers or integers.

    Args:
        path: The .npy file.
        max_values: The largest number of values that is read.

    Raises:
        InputError: The file is missing, damaged, too large, or has no numbers.
    """
    source, at = check_file(path, max_bytes=8 * max_values + 2**16), Location(path)
    try:
        with source.open("rb") as stream:
            version = npy.read_magic(stream)
            header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
            shape, _, kind = header(stream, max_header_size=_MAX_HEADER)
            if kind.kind not in "fiu" or math.prod(shape) > max_values:
                raise at.error(f"an array of {kind} and shape {shape}", f"at most {max_values} numbers")
            stream.seek(0)
            return np.asarray(npy.read_array(stream, allow_pickle=False, max_header_size=_MAX_HEADER))
    except (ValueError, OSError, EOFError, SyntaxError) as error:
        raise at.error(f"no NumPy array: {error}", "a whole .npy file of numbers") from error
