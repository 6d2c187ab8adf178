"""NetCDF files written by way of memory.

HDF5 cannot be trusted with a disk that fills up: the process ends with a segmentation fault, and takes what was not yet written
with it. So it writes into memory, and the bytes go to the disk as those of any other file.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import xarray as xr

from poseppl.errors import FilePath
from poseppl.files.atomic_writing import atomic_path


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
