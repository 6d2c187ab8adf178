"""NetCDF files from anywhere: what they declare is bounded before any of it is read.

An HDF5 file of a few kilobytes may declare arrays of many gigabytes, groups without end or within each other, and data that
lies in other files. So its groups are walked first, reading names, shapes and texts alone. Refused are links, virtual and
external data, objects of two names (among them all cycles), and more groups, variables or bytes than stated here.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from typing import Any, NamedTuple, NoReturn

import h5py
import numpy as np
import xarray as xr

from poseppl.errors import FilePath, InputError
from poseppl.files.bounded_reading import check_file

MAX_BYTES = 4 * 2**30
"""Bound on what a file holds when unpacked, unless the environment variable POSEPPL_MAX_GIB says otherwise."""
MAX_GROUPS = 100
MAX_DEPTH = 8
MAX_OBJECTS = 5_000
MAX_DIMENSIONS = 32
MAX_ATTRIBUTES = 500
MAX_TEXTS = 100_000
_DEFLATE = 1032
"""No stream of deflate unpacks to more times its size."""
_SLACK = 64 * 2**20
_DAMAGED = "not a NetCDF file, or a damaged one"


def read_netcdf(path: FilePath, *, expected: str, max_bytes: int | None = None) -> xr.DataTree:
    """Read a NetCDF file into memory.

    Args:
        path: The file.
        expected: What it should be, for messages.
        max_bytes: The most that it may hold when unpacked; by default :data:`MAX_BYTES`, or POSEPPL_MAX_GIB.

    Returns:
        The tree.

    Raises:
        InputError: The file is missing, no NetCDF, damaged, or declares more than the bounds.
    """
    check_netcdf(path, expected=expected, max_bytes=max_bytes)
    try:
        with xr.open_datatree(path, engine="h5netcdf", phony_dims="access") as opened:
            return opened.load()
    except MemoryError as error:
        raise InputError("it does not fit into memory", file=path) from error
    except Exception as error:  # HDF5 raises anything at all on damaged bytes
        raise InputError(_DAMAGED, file=path, expected=expected) from error


def check_netcdf(path: FilePath, *, expected: str, max_bytes: int | None = None) -> None:
    """Check what a file declares, reading names, shapes, attributes and texts alone; arguments and errors as `read_netcdf`."""
    size = check_file(path, max_bytes=2**40).stat().st_size
    limit = _limit() if max_bytes is None else max_bytes
    if size > limit:
        _refuse_bytes(path, size, limit)
    total = 0
    try:
        with h5py.File(path, "r") as file:
            for found in _walk(path, file):
                total += found.bytes
                if total > _DEFLATE * size + _SLACK:
                    problem = f"{size} bytes declare {total / 2**20:.0f} MiB, more than any compression packs"
                    raise InputError(problem, file=path, field=found.name, expected=expected)
                if total > limit:
                    _refuse_bytes(path, total, limit)
    except InputError:
        raise
    except Exception as error:
        raise InputError(_DAMAGED, file=path, expected=expected) from error


def _limit() -> int:
    given = os.environ.get("POSEPPL_MAX_GIB")
    if given is None:
        return MAX_BYTES
    try:
        return int(float(given) * 2**30)
    except (ValueError, OverflowError) as error:
        raise InputError(f"{given[:40]!r}", field="POSEPPL_MAX_GIB", expected="a number of GiB") from error


def _refuse_bytes(path: FilePath, total: int, limit: int) -> NoReturn:
    raise InputError(
        f"it declares {total / 2**30:.1f} GiB or more",
        file=path,
        expected=f"at most {limit / 2**30:.3g} GiB; set POSEPPL_MAX_GIB for more",
    )


class _Found(NamedTuple):
    """A group or a variable: its name, and how many bytes it takes when it is read, with its attributes."""

    name: str
    bytes: int


def _walk(path: FilePath, root: h5py.File) -> Iterator[_Found]:
    waiting: list[tuple[h5py.Group, int]] = [(root, 0)]
    seen = {h5py.h5o.get_info(root.id).addr}
    num_groups = 0
    while waiting:
        group, depth = waiting.pop()
        num_groups += 1
        if num_groups > MAX_GROUPS or depth > MAX_DEPTH:
            _refuse(path, group.name, "too many groups", f"at most {MAX_GROUPS}, {MAX_DEPTH} levels deep")
        if len(group) + len(seen) > MAX_OBJECTS:
            _refuse(path, group.name, "too many variables", f"at most {MAX_OBJECTS}")
        yield _Found(group.name, _attribute_bytes(path, group))
        for name in group:
            where = f"{group.name.rstrip('/')}/{name}"
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                _refuse(path, where, "a link", "data in the file itself")
            inner = group[name]
            address = h5py.h5o.get_info(inner.id).addr
            if address in seen:
                _refuse(path, where, "an object of two names", "each group and variable once")
            seen.add(address)
            if isinstance(inner, h5py.Group):
                waiting.append((inner, depth + 1))
            else:
                yield _Found(where, _attribute_bytes(path, inner) + _data_bytes(path, where, inner))


def _data_bytes(path: FilePath, where: str, item: Any) -> int:
    if not isinstance(item, h5py.Dataset) or item.shape is None:
        _refuse(path, where, "neither a group nor a variable", "arrays of numbers or texts")
    if item.is_virtual or item.id.get_create_plist().get_external_count():
        _refuse(path, where, "its values lie elsewhere", "data in the file itself")
    count = int(math.prod(item.shape))
    text = h5py.check_string_dtype(item.dtype)
    if text is None and item.dtype.kind not in "iufbS":
        _refuse(path, where, f"values of type {item.dtype}", "numbers or texts")
    declared: int = count * int(item.dtype.itemsize)
    if text is None or text.length is not None:
        return declared
    if count > MAX_TEXTS:
        _refuse(path, where, f"{count} texts", f"at most {MAX_TEXTS}")
    return declared + sum(len(item[index]) for index in np.ndindex(item.shape))  # many may be one and the same in the file


def _attribute_bytes(path: FilePath, item: Any) -> int:
    if len(item.attrs) > MAX_ATTRIBUTES:
        _refuse(path, item.name, f"{len(item.attrs)} attributes", f"at most {MAX_ATTRIBUTES}")
    total = 0
    for name in item.attrs:
        attribute = item.attrs.get_id(name)
        count = math.prod(attribute.shape)
        total += int(attribute.get_storage_size())
        if h5py.check_vlen_dtype(attribute.dtype) is not None or h5py.check_string_dtype(attribute.dtype) is not None:
            if count > MAX_DIMENSIONS:
                _refuse(path, item.name, f"an attribute of {count} texts", f"at most {MAX_DIMENSIONS}")
            total += sum(len(value) for value in np.ravel(np.asarray(item.attrs[name], object)))
    return total


def _refuse(path: FilePath, name: str, problem: str, expected: str) -> NoReturn:
    raise InputError(problem, file=path, field=name[:80], expected=expected)
