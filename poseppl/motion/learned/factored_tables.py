"""The tables of a factored-state hierarchical hidden Markov model of a body's motion, and their files.

Peursum, Venkatesh and West (2010, doi:10.1007/s11263-009-0205-5, section 3.3); :mod:`poseppl_models.peursum.factored_system`
makes programs of them, and tells what each means.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import xarray as xr
from jax import Array

from poseppl.errors import FilePath, InputError
from poseppl.files.netcdf_reading import read_netcdf
from poseppl.files.netcdf_writing import write_netcdf

NUM_BINS = 120
"""Number of cells of a turn: 3 degrees each."""
STAYS = 0.5
"""w, ours."""
_LAYOUT = 2
_EXPECTED = "tables of a factored motion"
_MAX_BYTES = 2**28


class FactoredTables(NamedTuple):
    """Probabilities of M phases, D rotations and B bins, a frame of the recording after the other.

    Attributes:
        first_phase: phi (M,), Eq. 7d.
        first_bins: varphi (M, D, B), Eq. 7e.
        phases: C (M, M), Eq. 7a; rows are the phase before.
        entries: A of a rotation that enters a phase (M, D, B), Eq. 7c.
        steps: A of one that goes on (M, D, B, B), Eq. 7b, rows the bin before; a row of zeros where the phase knows no
            successor of the bin.
        velocities: m (M, 3), mean velocity: forwards, to the left and up, mm/s.
        stays: w (), the probability that the position does not follow the heading.
    """

    first_phase: Array
    first_bins: Array
    phases: Array
    entries: Array
    steps: Array
    velocities: Array
    stays: Any = STAYS

    def successors(self, phase: Array, bins: Array) -> Array:
        """Probabilities (D, B) of the next bins, in a phase and after bins (D,): Eqs. 7b, 7c and 26."""
        rows = self.steps[phase, jnp.arange(self.steps.shape[1]), bins]
        ends = jnp.sum(rows, -1, keepdims=True) <= 0
        return jnp.where(ends, self.entries[phase], rows)


def bin_angles(bins: Any, num_bins: int = NUM_BINS) -> Array:
    """Middles of bins, radians from -pi to pi."""
    return (jnp.asarray(bins) + 0.5) * (2 * jnp.pi / num_bins) - jnp.pi


def bins_of(angles: Any, num_bins: int = NUM_BINS) -> Any:
    """Bins of angles, radians."""
    turns = np.asarray(angles) / (2 * np.pi) + 0.5
    return np.floor((turns - np.floor(turns)) * num_bins).astype(int) % num_bins


def root_places(coordinates: Sequence[tuple[str, str]]) -> list[int]:
    """Indices of the root's x, y and z and of its turn about the vertical."""
    root = coordinates[0][0]
    return [list(coordinates).index((root, axis)) for axis in ("tx", "ty", "tz", "Z")]


def write_factored_tables(tables: FactoredTables, path: FilePath) -> None:
    """Write tables, whole or not at all.

    Raises:
        InputError: The folder is missing or cannot be written.
        PosepplError: The disk is full.
    """
    arrays = {name: (_DIMS[name], np.asarray(getattr(tables, name))) for name in tables._fields}
    write_netcdf(xr.DataTree(xr.Dataset(arrays, attrs={"poseppl_factored_tables": _LAYOUT})), path)


def read_factored_tables(path: FilePath) -> FactoredTables:
    """Read tables and check that they are some.

    Raises:
        InputError: The file is missing, damaged, or holds no tables; the message names the field.
    """
    data = read_netcdf(path, expected=_EXPECTED, max_bytes=_MAX_BYTES).to_dataset()
    if data.attrs.get("poseppl_factored_tables") != _LAYOUT:
        raise InputError("it has no tables of this version", file=path, expected=_EXPECTED)
    for name, dims in _DIMS.items():
        if name not in data or data[name].dims != dims or not np.isfinite(data[name].values).all():
            raise InputError("missing, not finite, or of other dimensions", file=path, field=name, expected=" x ".join(dims))
        total = data[name].values.sum(-1) if dims else data[name].values
        fine = name in ("velocities", "stays") or (
            (data[name].values >= 0).all() and np.all(_ones(total) | (_zeros(total, name)))
        )
        if not fine:
            raise InputError("no probabilities", file=path, field=name, expected="rows that sum to one")
    tables = (jnp.asarray(data[name].values, float) for name in FactoredTables._fields)
    return FactoredTables(*tables)


_DIMS: dict[str, tuple[str, ...]] = {
    "first_phase": ("phase",),
    "first_bins": ("phase", "rotation", "bin"),
    "phases": ("phase", "next_phase"),
    "entries": ("phase", "rotation", "bin"),
    "steps": ("phase", "rotation", "bin", "next_bin"),
    "velocities": ("phase", "axis"),
    "stays": (),
}


def _ones(total: Any) -> Any:
    return np.abs(total - 1) < 1e-4


def _zeros(total: Any, name: str) -> Any:
    """Rows that know no successor."""
    return (total == 0) & (name == "steps")
