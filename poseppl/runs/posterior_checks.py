r"""Checks of a smoothed result, which need no truth: its draws against the model that they are said to be draws of.

If model and smoother are right, a smoothed trajectory x and its data z are together a draw of the model, (x, z) ~ p(x, z), as
the true trajectory and z are. So smoothed draws and the data satisfy every property of states and data that the model itself
draws (Johnson 2007, doi:10.1214/07-BA229; Yuan and Johnson 2012, doi:10.1111/j.1541-0420.2011.01668.x):

* data:   E[(z_t - E[z | x_t])^2 / Var[z | x_t]] = 1 for each entry,
* steps:  E[(x_t - a)^2] = E[(b - a)^2] for each coordinate, a and b being two draws of the transition from x_(t-1), which needs
  no moments, and draws of whole trajectories.

Averages over draws do not change the expectations. :func:`check_posterior` keeps both sides, frame by frame;
:mod:`poseppl.diagnostics.smoothing` sums them up.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jax import Array

from poseppl.checks import check_at_least
from poseppl.compilation import jit
from poseppl.errors import InputError
from poseppl.particles.stacks import tree_index
from poseppl.program import CompiledModel, Observation
from poseppl.program.earlier_inputs import with_earlier_data
from poseppl.program.population import propagate
from poseppl.runs.contents import arrays_of, flat_draws
from poseppl.runs.frame_sequence import stacked_inputs
from poseppl.runs.model_fingerprint import check_same_model
from poseppl.runs.results import provenance

GROUP = "posterior_checks"
"""The group of a result that holds the checks."""
_HIDES = 0.75
"""Variance of an entry's expectation over the draws, in units of its noise, from which it is left out: more than a posterior
can leave, such as that of a Gaussian which a projection bends."""
_MIN = 8
"""Draws below which nothing is checked: a single path is no draw."""


def check_posterior(
    result: xr.DataTree,
    model: CompiledModel,
    rng_key: Array,
    inputs: Any = None,
    *,
    data: Observation | None = None,
    num_draws: int = 50,
) -> xr.DataTree:
    """Add the checks of its draws to a smoothed result.

    Args:
        result: The result of :func:`poseppl.smooth`.
        model: The model that it is one of.
        rng_key: PRNG key.
        inputs: The filter's inputs.
        data: The data that were smoothed; those that the result holds if None.
        num_draws: The most draws that are looked at, evenly chosen.

    Returns:
        The result with the group ``posterior_checks`` (a shallow copy): ``data_square``, the mean squared residual of a
        frame's data over what the draws expect of it, and ``data_seen``, the number of observed entries, (frame,). For draws of
        whole trajectories also ``step_square`` and ``step_expected`` (frame, state_dim), NaN in the first frame. Without the
        group if it has fewer than 8 draws.

    Raises:
        InputError: The result is not smoothed.
        ValueError: It is one of other coordinates or params, or inputs or data do not fit.
    """
    check_at_least(1, num_draws=num_draws)
    if data is None:  # whoever has data of another form may name coordinates otherwise, too
        check_same_model(result, model)
    known = provenance(result)
    if "smoother" not in known:
        raise InputError("the result is not smoothed", expected="the result of smooth; infer(..., predict=) checks a filter")
    state = flat_draws(result).transpose("frame", "chain", "draw", "state_dim").values
    draws = state.reshape(len(state), -1, state.shape[-1])
    if draws.shape[1] < _MIN:
        return result
    number = min(num_draws, draws.shape[1])
    draws = draws[:, np.arange(number) * draws.shape[1] // number]
    observations = model.observe(arrays_of(result, "observed_data")) if data is None else data
    rows = stacked_inputs(with_earlier_data(model, observations, inputs), len(draws))
    key_data, key_steps = jax.random.split(rng_key)
    checks: dict[str, Any] = {}
    if model.why_not_predictive(None if rows is None else tree_index(rows, 0)) is None:
        square, seen = _data(model, jax.random.split(key_data, len(draws)), draws, observations, rows)
        checks |= {"data_square": ("frame", np.asarray(square)), "data_seen": ("frame", np.asarray(seen))}
    if known.get("joint") and len(draws) > 1:
        later = tree_index(rows, slice(1, None))
        steps = _steps(model, jax.random.split(key_steps, len(draws) - 1), draws[1:], draws[:-1], later)
        first = np.full((1, draws.shape[-1]), np.nan)
        for name, values in zip(("step_square", "step_expected"), steps, strict=True):
            checks[name] = (("frame", "state_dim"), np.concatenate([first, np.asarray(values)]))
    coords = {"frame": flat_draws(result)["frame"].values, "state_dim": flat_draws(result)["state_dim"].values}
    checked = result.copy()
    checked[GROUP] = xr.DataTree(xr.Dataset(checks, coords=coords))
    return checked


@partial(jit, static_argnums=0)
def _data(model: CompiledModel, keys: Array, draws: Array, observations: Observation, inputs: Any) -> tuple[Array, Array]:
    """Mean squared standardised residual, and the number of entries that count (T,), of draws (T, S, d)."""

    def frame(row: Any) -> tuple[Array, Array]:
        key, states, observation, frame_inputs = row
        drawn = jax.vmap(lambda key, x: model.draw_data(key, x, frame_inputs))(jax.random.split(key, states.shape[0]), states)
        data, seen = model.flat_observation(observation)
        known = seen & jnp.all(jnp.isfinite(drawn.mean) & (drawn.variance > 0) & jnp.isfinite(drawn.variance), 0)
        known &= jnp.var(drawn.mean, 0) < _HIDES * jnp.mean(drawn.variance, 0)
        squares = jnp.where(known, (data - drawn.mean) ** 2 / jnp.where(known, drawn.variance, 1.0), 0.0)
        count = jnp.sum(known)
        return jnp.mean(jnp.sum(squares, 1)) / jnp.maximum(count, 1), count

    found: tuple[Array, Array] = jax.lax.map(frame, (keys, draws, observations, inputs))
    return found


@partial(jit, static_argnums=0)
def _steps(model: CompiledModel, keys: Array, draws: Array, previous: Array, inputs: Any) -> tuple[Array, Array]:
    """Mean squared distances (T - 1, d) of draws, and of other draws of the transition, from one of the transition."""

    def frame(row: Any) -> tuple[Array, Array]:
        key, states, before, frame_inputs = row
        one, other = (
            propagate(model, jax.random.split(each, states.shape[0]), before, frame_inputs) for each in jax.random.split(key)
        )
        return jnp.mean((states - one) ** 2, 0), jnp.mean((other - one) ** 2, 0)

    found: tuple[Array, Array] = jax.lax.map(frame, (keys, draws, previous, inputs))
    return found
