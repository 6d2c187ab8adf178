"""NetCDF files: read with what they declare bounded before any of it is read, and written by way of memory.

An HDF5 file of a few kilobytes may declare arrays of many gigabytes, groups without end or within each other, and data that
lies in other files. So its groups are walked first, reading names, shapes and texts alone. Refused are links, virtual and
external data, objects of two names (among them all cycles), and more groups, variables or bytes than stated here.

HDF5 cannot be trusted with a disk that fills up: the process ends with a segmentation fault, and takes what was not yet written
with it. So it writes into memory, and the bytes go to the disk as those of any other file.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from typing import Any, NoReturn

import h5py
import numpy as np
import xarray as xr

from poseppl.errors import FilePath, InputError, Location, brief
from poseppl.files.atomic_writing import atomic_path
from poseppl.files.bounded_reading import check_file
from poseppl.files.hdf5_reading import DEFLATE, child, declared_bytes, open_hdf5

MAX_BYTES = 4 * 2**30
"""Bound on the unpacked size of a file, unless the environment variable POSEPPL_MAX_GIB says otherwise."""
MAX_FILE_BYTES = 2**40
MAX_GROUPS = 100
MAX_DEPTH = 8
MAX_OBJECTS = 5_000
MAX_DIMENSIONS = 32
MAX_ATTRIBUTES = 500
_SLACK = 64 * 2**20


def read_netcdf(path: FilePath, *, expected: str, max_bytes: int | None = None) -> xr.DataTree:
    """Read a NetCDF file into memory.

    Args:
        path: The file.
        expected: The expected content, for messages.
        max_bytes: Its largest unpacked size; by default :data:`MAX_BYTES`, or POSEPPL_MAX_GIB.

    Returns:
        The tree.

    Raises:
        InputError: The file is missing, no NetCDF, damaged, or declares more than the bounds.
    """
    check_netcdf(path, expected=expected, max_bytes=max_bytes)
    with open_hdf5(path, expected, MAX_FILE_BYTES), xr.open_datatree(path, engine="h5netcdf", phony_dims="access") as opened:
        return opened.load()


def check_netcdf(path: FilePath, *, expected: str, max_bytes: int | None = None) -> None:
    """Check what a file declares, reading names, shapes, attributes and texts alone; arguments and errors as `read_netcdf`."""
    size = check_file(path, max_bytes=MAX_FILE_BYTES).stat().st_size
    limit = _limit() if max_bytes is None else max_bytes
    if size > limit:
        _refuse_bytes(path, size, limit)
    total = 0
    with open_hdf5(path, expected, MAX_FILE_BYTES) as file:
        for name, declared in _walk(Location(path), file):
            total += declared
            if total > DEFLATE * size + _SLACK:
                problem = f"{size} bytes declare {total / 2**20:.0f} MiB, more than any compression packs"
                raise Location(path, field=name).error(problem, expected)
            if total > limit:
                _refuse_bytes(path, total, limit)


def _limit() -> int:
    given = os.environ.get("POSEPPL_MAX_GIB")
    if given is None:
        return MAX_BYTES
    try:
        return int(float(given) * 2**30)
    except (ValueError, OverflowError) as error:
        raise InputError(brief(given), field="POSEPPL_MAX_GIB", expected="a number of GiB") from error


def _refuse_bytes(path: FilePath, total: int, limit: int) -> NoReturn:
    raise InputError(
        f"it declares {total / 2**30:.1f} GiB or more",
        file=path,
        expected=f"at most {limit / 2**30:.3g} GiB; set POSEPPL_MAX_GIB for more",
    )


def _walk(at: Location, root: h5py.File) -> Iterator[tuple[str, int]]:
    """Names of all groups and variables, and how many bytes each takes when it is read, with its attributes."""
    waiting: list[tuple[h5py.Group, int]] = [(root, 0)]
    seen = {h5py.h5o.get_info(root.id).addr}
    num_groups = 0
    while waiting:
        group, depth = waiting.pop()
        here = at.in_field(group.name)
        num_groups += 1
        if num_groups > MAX_GROUPS or depth > MAX_DEPTH:
            raise here.error("too many groups", f"at most {MAX_GROUPS}, {MAX_DEPTH} levels deep")
        if len(group) + len(seen) > MAX_OBJECTS:
            raise here.error("too many variables", f"at most {MAX_OBJECTS}")
        yield group.name, _attribute_bytes(here, group)
        for name in group:
            inner = child(group, name, at)
            where = at.in_field(f"{group.name.rstrip('/')}/{name}")
            address = h5py.h5o.get_info(inner.id).addr
            if address in seen:
                raise where.error("an object of two names", "each group and variable once")
            seen.add(address)
            if isinstance(inner, h5py.Group):
                waiting.append((inner, depth + 1))
            else:
                yield inner.name, _attribute_bytes(where, inner) + declared_bytes(inner, where)


def _attribute_bytes(at: Location, item: Any) -> int:
    if len(item.attrs) > MAX_ATTRIBUTES:
        raise at.error(f"{len(item.attrs)} attributes", f"at most {MAX_ATTRIBUTES}")
    total = 0
    for name in item.attrs:
        attribute = item.attrs.get_id(name)
        count = math.prod(attribute.shape)
        total += int(attribute.get_storage_size())
        if h5py.check_vlen_dtype(attribute.dtype) is not None or h5py.check_string_dtype(attribute.dtype) is not None:
            if count > MAX_DIMENSIONS:
                raise at.error(f"an attribute of {count} texts", f"at most {MAX_DIMENSIONS}")
            total += sum(len(value) for value in np.ravel(np.asarray(item.attrs[name], object)))
        if total > item.file.id.get_filesize():  # many texts may be one and the same in the file
            raise at.error("attributes of more bytes than the file", "no more")
    return total


def write_netcdf(
    tree: xr.DataTree, path: FilePath, encoding: Mapping[str, Mapping[str, Mapping[str, Any]]] | None = None
) -> None:
    """Write a tree as NetCDF, whole or not at all.

    Args:
        tree: The tree; it is untouched, whatever happens to the disk.
        path: The file, overwritten if it exists.
        encoding: Encoding of variables by group, for xarray.

    Raises:
        InputError: The folder is missing or cannot be written.
        PosepplError: The disk is full.
    """
    data: Any = tree.to_netcdf(engine="h5netcdf", encoding=encoding)
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)
