r"""A learned activity (Darby, Li and Costen 2008, doi:10.1109/AFGR.2008.4813348, sections 4 and 5), and its files.

L of a body's d coordinates are learned; the root's six and the head's three are free. The learned angles are

    epsilon ~ mean + \bar\epsilon + \Phi f   (Eq. 1),       f = \Phi^T (epsilon - mean - \bar\epsilon)   (Eq. 2),

with each person's own mean angles, or for an unknown person the average of them. The features f (eta,) are emissions of a
hidden Markov model with N states: s_t ~ A[s_(t-1)], f_t ~ N(mu_s, Sigma_s).

Nothing in a file is run: the body that it names is looked up among the installed ones by who uses it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from poseppl.arrays import Floats, Integers
from poseppl.errors import FilePath, InputError
from poseppl.files.netcdf import read_netcdf, write_netcdf
from poseppl.motion.learned.angles import wrapped

MEMORY = 0.1
"""Seconds after which what an unknown person does otherwise is another (ours): it changes within the cycle of an activity."""
_MAX_KEPT = 0.9999
"""Correlation from a frame to the next that a residual has at most, so that it is never known without an error."""


class MotionModel(NamedTuple):
    r"""A learned activity.

    Attributes:
        body: Builder of the body, by name.
        rate: Frames a second that a transition stands for.
        coordinates: Names of the body's d coordinates.
        learned: Indices of those that are learned (L,), ascending.
        persons: Names of the P persons.
        person_means: Their mean angles (P, L), radians.
        centre: Mean \bar\epsilon of what is left of the angles (L,).
        components: Phi (L, eta), orthonormal columns.
        spectrum: Variances along all principal components (L,), descending.
        initial: Probabilities of the first state (N,).
        transition: A (N, N), rows sum to one.
        means: mu (N, eta).
        covariances: Sigma (N, eta, eta).
        residual_scale: Standard deviations of the angles about the components (L,), radians.
        residual_correlation: Correlation of these from a frame to the next (L,).
        step_scale: Root mean square change of each coordinate from a frame to the next (d,), mm and radians.
        largest_step: Largest such change (d,).
        limits: Least and largest value of each coordinate (d, 2); infinite for the root's.
        log_likelihoods: Log-likelihood of the training data after each round of Baum-Welch.
        provenance: Record of its training: files, frames, settings, versions.
    """

    body: str
    rate: float
    coordinates: tuple[str, ...]
    learned: Integers
    persons: tuple[str, ...]
    person_means: Floats
    centre: Floats
    components: Floats
    spectrum: Floats
    initial: Floats
    transition: Floats
    means: Floats
    covariances: Floats
    residual_scale: Floats
    residual_correlation: Floats
    step_scale: Floats
    largest_step: Floats
    limits: Floats
    log_likelihoods: Floats
    provenance: Mapping[str, Any]

    @property
    def free(self) -> Integers:
        """Indices of the coordinates that are not learned."""
        return np.setdiff1d(np.arange(len(self.coordinates)), self.learned)

    @property
    def explained(self) -> float:
        """Fraction of the variance that the components keep."""
        return float(self.spectrum[: self.components.shape[1]].sum() / self.spectrum.sum())

    def mean_angles(self, person: str | None = None) -> Floats:
        """Mean angles (L,) of a person, with the centre; without one, those of an unknown person: the average of all.

        Raises:
            KeyError: There is no such person.
        """
        if person is not None and person not in self.persons:
            raise KeyError(person)
        own = self.person_means.mean(0) if person is None else self.person_means[self.persons.index(person)]
        return np.asarray(own + self.centre)

    def residuals(self, person: str | None = None) -> tuple[Floats, Floats]:
        """How far the angles of a person stay from :meth:`angles`, and for how long.

        For an unknown person this includes the distance of its mean from the average, as the persons' means have it. Other
        deviations last for :data:`MEMORY`.

        Returns:
            Standard deviations (L,) in radians, and correlations from a frame to the next (L,), below 1.
        """
        if person is not None:
            return self.residual_scale, np.minimum(self.residual_correlation, _MAX_KEPT)
        variance, count = self.residual_scale**2, len(self.persons)
        if count > 1:
            apart = wrapped(self.person_means - self.person_means.mean(0))
            variance = variance + np.sum(apart**2, 0) / (count - 1) * (1 + 1 / count)
        return np.sqrt(variance), np.full(len(variance), np.exp(-1 / (self.rate * MEMORY)))

    def features(self, states: ArrayLike, person: str | None = None) -> Floats:
        """Features (T, eta) of states (T, d), by Eq. 2."""
        left = wrapped(np.asarray(states, np.float64)[..., self.learned] - self.mean_angles(person))
        return np.asarray(left @ self.components)

    def angles(self, features: ArrayLike, person: str | None = None) -> Floats:
        """Learned angles (T, L) of features (T, eta), by Eq. 1."""
        return np.asarray(self.mean_angles(person) + np.asarray(features, np.float64) @ self.components.T)


LAYOUT = 1
_EXPECTED = "a file of poseppl fit-motion"
MAX_BYTES = 2**28
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
    data = read_netcdf(path, expected=_EXPECTED, max_bytes=MAX_BYTES).to_dataset()
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
