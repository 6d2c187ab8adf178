"""Params that a fit found, and a model that has them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
import xarray as xr

from poseppl.errors import InputError
from poseppl.program import CompiledModel

ESTIMATE = "estimate"
"""The group of a fit that holds its estimate of each param, and standard errors."""


def fitted_params(fit: xr.DataTree, draw: int | None = None) -> dict[str, Any]:
    """The params of a fit by name.

    Args:
        fit: The result of :func:`poseppl.fit`.
        draw: Which of its draws, counted through all chains; the estimate if None.

    Raises:
        InputError: It is no fit, has no such draw, or a param has no value.
    """
    if not isinstance(fit, xr.DataTree) or ESTIMATE not in fit.children:
        raise InputError(f"a {type(fit).__name__} without an estimate", field="fit", expected="the result of poseppl.fit")
    names = [str(name) for name in fit["posterior"].dataset.data_vars]
    if draw is None:
        params = {name: fit[ESTIMATE].dataset[name].values for name in names}
    else:
        draws = {name: fit["posterior"].dataset[name].values for name in names}
        chain, number = divmod(draw, next(iter(draws.values())).shape[1])
        if not 0 <= chain < len(next(iter(draws.values()))):
            raise InputError(f"there is no draw {draw}", field="draw", expected="a number of one, or None for the estimate")
        params = {name: each[chain, number] for name, each in draws.items()}
    for name, value in params.items():
        if not np.isfinite(value).all():
            raise InputError(f"{name} is {value}", field="fit", expected="a finite value; read poseppl.findings_of_fit(fit)")
    return params


def with_checked_params(model: CompiledModel, params: Mapping[str, Any] | xr.DataTree) -> CompiledModel:
    """The model with params by name, or those of a fit.

    Raises:
        InputError: Params with other names than the parameters program, or the model's own.
    """
    given = fitted_params(params) if isinstance(params, xr.DataTree) else params
    if model.programs.parameters is not None:
        known = list(jax.eval_shape(model.sample_parameters, jax.random.key(0)))
        if set(given) != set(known):
            raise InputError(f"params are {sorted(given)}", expected=f"those of the parameters program, {sorted(known)}")
    elif isinstance(model.params, Mapping) and set(given) != set(model.params):
        raise InputError(f"params are {sorted(given)}", expected=f"those that the model has, {sorted(model.params)}")
    return model.with_params(given)
