"""Files of learned activities: NetCDF, written whole or not at all, and checked when they are read.

Nothing in a file is run: the body that it names is looked up among the installed ones by who uses it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from poseppl.errors import FilePath, InputError
from poseppl.files.netcdf_reading import read_netcdf
from poseppl.files.netcdf_writing import write_netcdf
from poseppl.motion.learned.motion_model import MotionModel

LAYOUT = 1
_EXPECTED = "a file of poseppl fit-motion"
_MAX_BYTES = 2**28
_DIMS: Mapping[str, tuple[str, ...]] = {
    "learned": ("angle",),
    "person_means": ("person", "angle"),
    "centre": ("angle",),
    "components": ("angle", "component"),
    "spectrum": ("angle",),
    "initial": ("state",),
    "transition": ("state", "next_state"),
    "means": ("state", "component"),
    "covariances": ("state", "component", "other_component"),
    "residual_scale": ("angle",),
    "residual_correlation": ("angle",),
    "step_scale": ("coordinate",),
    "largest_step": ("coordinate",),
    "limits": ("coordinate", "bound"),
    "log_likelihoods": ("round",),
}
_SAME = {"next_state": "state", "other_component": "component"}


def write_motion_model(model: MotionModel, path: FilePath) -> None:
    """Write a model, whole or not at all.

    Raises:
        InputError: The folder is missing or cannot be written.
        PosepplError: The disk is full.
    """
    arrays = {name: (dims, getattr(model, name)) for name, dims in _DIMS.items()}
    names = {"coordinate": list(model.coordinates), "person": list(model.persons)}
    attrs = {
        "poseppl_motion_model": LAYOUT,
        "body": model.body,
        "rate": model.rate,
        "provenance": json.dumps(dict(model.provenance)),
    }
    write_netcdf(xr.DataTree(xr.Dataset(arrays, names, attrs)), path)


def read_motion_model(path: FilePath) -> MotionModel:
    """Read a model and check that it is one.

    Raises:
        InputError: The file is missing, damaged, of another layout, or no model; the message names the field.
    """
    data = read_netcdf(path, expected=_EXPECTED, max_bytes=_MAX_BYTES).to_dataset()
    layout = data.attrs.get("poseppl_motion_model")
    if layout != LAYOUT:
        problem = "it is no learned motion" if layout is None else f"it is of layout {layout}"
        raise InputError(problem, file=path, expected=f"{_EXPECTED} of this version")
    arrays = {name: _array(path, data, name) for name in _DIMS}
    try:
        body, rate, provenance = str(data.attrs["body"]), float(data.attrs["rate"]), json.loads(data.attrs["provenance"])
        names = {dim: tuple(str(name) for name in data.indexes[dim]) for dim in ("coordinate", "person")}
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"its content is unknown: {error}", file=path, expected=_EXPECTED) from error
    if not isinstance(provenance, dict) or not 0 < rate < 1e6:
        raise InputError(f"{rate:g} frames a second", file=path, field="rate", expected="a positive number")
    model = MotionModel(
        body=body, rate=rate, coordinates=names["coordinate"], persons=names["person"], provenance=provenance, **arrays
    )
    _check(path, model)
    return model


def _array(path: FilePath, data: xr.Dataset, name: str) -> NDArray[Any]:
    dims = _DIMS[name]
    if name not in data or data[name].dims != dims:
        raise InputError("it is missing, or of other dimensions", file=path, field=name, expected=" x ".join(dims))
    values = data[name].values
    sizes = [data.sizes[_SAME.get(dim, dim)] for dim in dims]
    if list(values.shape) != sizes or values.dtype.kind not in "iuf":
        raise InputError(f"{values.dtype} of shape {values.shape}", file=path, field=name, expected=f"numbers of shape {sizes}")
    return np.asarray(values, int if name == "learned" else np.float64)


def _check(path: FilePath, model: MotionModel) -> None:
    """Refuse what is no model.

    Raises:
        InputError: Numbers that are not finite, probabilities that do not sum to one, or matrices that are none of a model.
    """
    eye = np.eye(model.components.shape[1])
    finite = [name for name in _DIMS if name != "limits" and not np.isfinite(getattr(model, name)).all()]
    inside = (model.learned >= 0) & (model.learned < len(model.coordinates))
    found = {
        **dict.fromkeys(finite, "finite numbers"),
        "learned": "indices of coordinates, ascending" if not (inside.all() and (np.diff(model.learned) > 0).all()) else "",
        "components": "orthonormal columns" if not np.allclose(model.components.T @ model.components, eye, atol=1e-6) else "",
        "spectrum": "" if model.spectrum.sum() > 0 and (model.spectrum >= 0).all() else "variances, some of them positive",
        "initial": _probabilities(model.initial),
        "transition": _probabilities(model.transition),
        "covariances": _covariances(model.covariances),
        "residual_scale": "" if (model.residual_scale >= 0).all() else "standard deviations",
        "residual_correlation": "" if np.all(np.abs(model.residual_correlation - 0.5) <= 0.5) else "numbers from 0 to 1",
        "step_scale": "" if (model.step_scale >= 0).all() else "standard deviations",
        "limits": "" if (model.limits[:, 0] <= model.limits[:, 1]).all() else "a least value and a largest one",
    }
    for name, expected in found.items():
        if expected:
            raise InputError("it is no part of a model", file=path, field=name, expected=expected)


def _probabilities(rows: NDArray[Any]) -> str:
    fine = (rows >= 0).all() and np.allclose(rows.sum(-1), 1.0, atol=1e-6)
    return "" if fine else "probabilities that sum to one"


def _covariances(matrices: NDArray[Any]) -> str:
    symmetric = np.allclose(matrices, matrices.swapaxes(1, 2), rtol=1e-6, atol=1e-12)
    fine = symmetric and (np.linalg.eigvalsh(matrices) > 0).all()
    return "" if fine else "symmetric positive matrices"
