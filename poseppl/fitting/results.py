"""The result of a fit: an xarray DataTree for ArviZ, with the estimate, its standard errors and what is wrong with it.

===========================  =================================================================================================
group                        variables
===========================  =================================================================================================
``posterior``                draws of the params by name, (chain, draw, ...): of maximum likelihood those of the Gaussian of its
                             standard errors, NaN where there is none
``unconstrained_posterior``  ``params`` (chain, draw, coordinate), the same draws as the flat vectors that methods see
``sample_stats``             statistics of the draws (chain, draw)
``estimate``                 of each param ``NAME``, its estimate, and ``NAME_se``, its standard error
``unconstrained_estimate``   ``params`` (coordinate,) and ``covariance`` (coordinate, other_coordinate)
``trace``                    ``objective`` (step,), log-likelihood, ELBO or evidence on the way
``observed_data``            the data by name, (frame, ...); NaN where missing
===========================  =================================================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jax import Array

from poseppl.arrays import Floats
from poseppl.compilation import jit_formula
from poseppl.diagnostics.verdicts.verdict import Remedy, Verdict
from poseppl.errors import FilePath, InputError
from poseppl.files.netcdf import read_netcdf
from poseppl.fitting.problem import Estimate, Problem
from poseppl.program import CompiledModel
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.parameters import parameter_bijector
from poseppl.runs.datasets import tree_of
from poseppl.runs.fitted_params import ESTIMATE
from poseppl.runs.results import encoded, provenance

VERSION = 1
"""Version of the layout, in the root attribute ``poseppl_fit``."""
_FINDINGS = "findings"


def fit_tree(problem: Problem, estimate: Estimate, method: str, findings: list[Verdict]) -> xr.DataTree:
    """Assemble the result of a fit."""
    bijector, draws = problem.bijector, estimate.draws
    u = draws.mean((0, 1)) if estimate.unconstrained is None else estimate.unconstrained
    values, jacobians, constrained = to_params(problem.model, u, draws)
    if estimate.covariance is None:
        covariance = np.atleast_2d(np.cov(draws.reshape(-1, draws.shape[2]).T))
        values = {name: each.mean((0, 1)) for name, each in constrained.items()}
        errors = {name: each.std((0, 1), ddof=1) for name, each in constrained.items()}
    else:
        covariance = estimate.covariance
        errors = delta_method(jacobians, covariance)
    names = list(bijector.sites)
    summary = {name: values[name] for name in names} | {f"{name}_se": errors[name] for name in names}
    flat = list(bijector.coordinate_names)
    both = {"coordinate": flat, "other_coordinate": flat}
    groups = {
        "posterior": xr.Dataset({name: (_dims(name, each, "chain", "draw"), each) for name, each in constrained.items()}),
        "unconstrained_posterior": xr.Dataset(
            {"params": (("chain", "draw", "coordinate"), draws)}, coords={"coordinate": flat}
        ),
        ESTIMATE: xr.Dataset({name: (_dims(name.removesuffix("_se"), each), each) for name, each in summary.items()}),
        "unconstrained_estimate": xr.Dataset(
            {"params": (("coordinate",), u), "covariance": (("coordinate", "other_coordinate"), covariance)}, coords=both
        ),
        "observed_data": _observed(problem),
    }
    for name in ("posterior", "unconstrained_posterior"):
        groups[name] = groups[name].assign_coords(chain=np.arange(draws.shape[0]), draw=np.arange(draws.shape[1]))
    if estimate.statistics:
        groups["sample_stats"] = xr.Dataset({name: (("chain", "draw"), each) for name, each in estimate.statistics.items()})
    if len(estimate.trace):
        groups["trace"] = xr.Dataset({"objective": (("step",), np.asarray(estimate.trace, np.float64))})
    recorded = {_FINDINGS: [[each.severity, each.finding, each.remedies] for each in findings]}
    return tree_of(groups, {"poseppl_fit": VERSION, **encoded({"method": method, **estimate.attrs, **recorded})})


ByName = dict[str, Floats]


def to_params(model: CompiledModel, u: Floats, draws: Floats) -> tuple[ByName, ByName, ByName]:
    """Params of u (p,) by name, their derivatives (..., p), and those of draws (M, R, p), NaN where a coordinate is."""
    found = _params_program(model)(*(jnp.asarray(each, jnp.result_type(float)) for each in (u, draws)))
    names = parameter_bijector(model).sites  # jit sorts them
    values, jacobians, constrained = ({name: np.asarray(each[name], np.float64) for name in names} for each in found)
    return values, jacobians, constrained


@memoized_builder
def _params_program(model: CompiledModel) -> Callable[[Array, Array], Any]:
    constrained = parameter_bijector(model).to_params
    return jit_formula(lambda u, draws: (constrained(u), jax.jacfwd(constrained)(u), jax.vmap(jax.vmap(constrained))(draws)))


def delta_method(jacobians: Mapping[str, Floats], covariance: Floats) -> ByName:
    """Standard errors of params by their derivatives (..., p); NaN where a coordinate that they depend on has no variance."""
    known = np.isfinite(np.diagonal(covariance))
    safe = np.where(known[:, None] & known, covariance, 0.0)
    errors = {}
    for name, rows in jacobians.items():
        variance = np.einsum("...i,ij,...j->...", rows, safe, rows)
        errors[name] = np.where((rows[..., ~known] != 0).any(-1), np.nan, np.sqrt(np.maximum(variance, 0.0)))
    return errors


def _dims(name: str, values: Any, *leading: str) -> tuple[str, ...]:
    """Dimensions of a param, as ArviZ names them."""
    return (*leading, *(f"{name}_dim_{axis}" for axis in range(np.ndim(values) - len(leading))))


def _observed(problem: Problem) -> xr.Dataset:
    """The data by name, NaN where they are missing."""
    values, mask = problem.observations
    seen = {name: np.where(np.asarray(mask[name]), np.asarray(each, np.float64), np.nan) for name, each in values.items()}
    return xr.Dataset({name: (_dims(name, each, "frame"), each) for name, each in seen.items()})


def findings_of_fit(fit: xr.DataTree) -> list[Verdict]:
    """Find problems of a fit, errors first; empty if no problem was detected.

    Args:
        fit: The result of :func:`poseppl.fit`.
    """
    recorded: Mapping[str, Any] = provenance(fit)
    found = [
        (severity, finding, [Remedy(*each) for each in remedies]) for severity, finding, remedies in recorded.get(_FINDINGS, ())
    ]
    return [Verdict(severity, finding, tuple(remedies)) for severity, finding, remedies in found]


def load_fit(path: FilePath, *, max_bytes: int | None = None) -> xr.DataTree:
    """Read a fit into memory.

    Args:
        path: A file that :func:`poseppl.save_result` wrote of a fit.
        max_bytes: The most that it may hold when unpacked; see :func:`poseppl.load_result`.

    Raises:
        InputError: The file is missing, no NetCDF, damaged, or holds no fit.
    """
    expected = "a fit written by poseppl.save_result"
    tree = read_netcdf(path, expected=expected, max_bytes=max_bytes)
    if tree.attrs.get("poseppl_fit") != VERSION or ESTIMATE not in tree.children:
        raise InputError("a NetCDF file, but no fit of poseppl", file=path, expected=expected)
    return tree
