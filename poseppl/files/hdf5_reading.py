"""Arrays of HDF5 files from anywhere: what a file declares is bounded before it is read, and nothing leads out of it.

Refused are links, virtual and external data, and arrays of more than :data:`MAX_BYTES`, or of more than any compression could
have packed into a file of that size.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import h5py
import numpy as np

from poseppl.errors import FilePath, InputError, Location, cut
from poseppl.files.bounded_reading import check_file

MAX_BYTES = 2**30
MAX_ATTRIBUTE_BYTES = 2**24
MAX_TEXTS = 100_000
MAX_CHUNK_BYTES = 2**24
DEFLATE = 1032
"""No stream of deflate unpacks to more times its size."""
_SLACK = 2**20
SIGNATURE = b"\x89HDF\r\n\x1a\n"


@contextmanager
def open_hdf5(path: FilePath, expected: str, max_bytes: int = MAX_BYTES) -> Iterator[h5py.File]:
    """Open a file to read; whatever HDF5 raises on damaged bytes becomes one error.

    Args:
        path: The file.
        expected: The expected content, for messages.
        max_bytes: The largest file that is read.

    Raises:
        InputError: The file is missing, too large, no HDF5, or damaged.
    """
    source = check_file(path, max_bytes=max_bytes)
    try:
        with h5py.File(source, "r") as file:
            yield file
    except InputError:
        raise
    except MemoryError as error:
        raise InputError("it does not fit into memory", file=path) from error
    except Exception as error:  # HDF5 raises anything at all on damaged bytes
        problem = "not an HDF5 or NetCDF file, a damaged one, or packed by a filter that HDF5 does not have"
        raise InputError(problem, file=path, expected=expected) from error


def child(group: Any, name: str, at: Location) -> Any:
    """A member of a group.

    Raises:
        InputError: It is missing, or a link.
    """
    where = at.in_field(f"{group.name.rstrip('/')}/{name}")
    link = group.get(name, getlink=True) if isinstance(group, h5py.Group) else None
    if link is None:
        raise where.error("it is missing")
    if not isinstance(link, h5py.HardLink):
        raise where.error("a link", "data in the file itself")
    return group[name]


def array(group: Any, name: str, at: Location) -> Any:
    """An array of a group, as NumPy has it.

    Raises:
        InputError: It is missing, a link, elsewhere, too large, or contains anything but numbers and texts of bounded length.
    """
    item = child(group, name, at)
    where = at.in_field(item.name)
    declared = declared_bytes(item, where, "iufbSV")
    if declared > MAX_BYTES:
        raise where.error(f"it declares {declared / 2**20:.0f} MiB", f"at most {MAX_BYTES // 2**20} MiB")
    values = item[()]
    return np.array([b"", *map(bytes, np.ravel(values))])[1:] if values.dtype.hasobject else values


def declared_bytes(item: Any, at: Location, kinds: str = "iufbS") -> int:
    """Bytes that an array takes when it is read; only texts of any length are read for it.

    Args:
        item: The member of a group.
        at: The file, for messages.
        kinds: Kinds of numbers and texts, as NumPy names them.

    Raises:
        InputError: It is no array of these kinds, its values are elsewhere or not in the file, its chunks are larger than
            itself, or there are too many texts.
    """
    if not isinstance(item, h5py.Dataset) or item.shape is None:
        raise at.error("no array", "numbers or texts")
    if item.is_virtual or item.id.get_create_plist().get_external_count():
        raise at.error("its values lie elsewhere", "data in the file itself")
    text, count = h5py.check_string_dtype(item.dtype), math.prod(item.shape)
    if text is None and (item.dtype.hasobject or item.dtype.kind not in kinds):
        raise at.error(f"values of type {cut(item.dtype, 60)}", "numbers or texts")
    declared = int(count * item.dtype.itemsize)
    chunk = math.prod(item.chunks or ()) * item.dtype.itemsize
    if chunk > max(declared, MAX_CHUNK_BYTES):
        raise at.error(
            f"chunks of {chunk / 2**20:.0f} MiB", f"at most {MAX_CHUNK_BYTES // 2**20} MiB where it is smaller itself"
        )
    if declared > DEFLATE * item.id.get_storage_size() + _SLACK:
        raise at.error(f"it declares {declared / 2**20:.0f} MiB", "what its part of the file can hold")
    if text is None or text.length is not None:
        return declared
    if count > MAX_TEXTS:
        raise at.error(f"{count} texts", f"at most {MAX_TEXTS}")
    return declared + _text_bytes(item, at)


def _text_bytes(item: Any, at: Location) -> int:
    """Bytes of texts of any length. Many may be one and the same in the file: no more are read than it could hold apart."""
    if not item.shape:
        return len(item[()])
    size, total = item.file.id.get_filesize(), 0
    step = max(1, _SLACK * 16 // size)
    for row in np.ndindex(item.shape[:-1]):
        for start in range(0, item.shape[-1], step):
            total += sum(map(len, item[(*row, slice(start, start + step))]))
            if total > size:
                raise at.error(f"texts of more than {size} bytes", "no more than the file has")
    return total


def attribute(item: Any, name: str, at: Location) -> Any:
    """An attribute, or None where there is none.

    Raises:
        InputError: It has more than 16 MiB, or refers to something.
    """
    if name not in item.attrs:
        return None
    stored = item.attrs.get_id(name)
    if stored.get_storage_size() > MAX_ATTRIBUTE_BYTES or h5py.check_ref_dtype(stored.dtype) is not None:
        raise at.in_field(name).error("an attribute that is too large, or a reference", "a text or numbers")
    return item.attrs[name]


def texts(values: Any) -> list[str]:
    """Texts of an array of bytes."""
    return [bytes(value).decode("utf-8", "replace") for value in np.ravel(values)]
