"""Whether static parameters are learned: chains that agree, and data that come as a filter with these parameters expects.

    draws = pmmh(model, key, observations, build_filter=kalman_filter).params
    check_parameters(draws, predictions_under(model, draws, observations, kalman_filter, key))

A model that is wrong has a posterior of its parameters, too, and chains that mix well on it. So the predictive checks of
filters (:mod:`poseppl.runs.predictive`) are made under a few draws of the posterior: where most of them are in error, no value
of the parameters that the data leave makes the model right.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jax import Array
from numpy.typing import ArrayLike

from poseppl.checks import check_at_least, check_key
from poseppl.compilation import jit
from poseppl.diagnostics.inefficiency import mixing
from poseppl.diagnostics.verdicts.predictive import check_predictions
from poseppl.diagnostics.verdicts.verdict import ERROR, WARNING, Findings, Verdict
from poseppl.errors import InputError
from poseppl.filters.base import Filter
from poseppl.filters.scan import scan_filter
from poseppl.program import CompiledModel, Observation
from poseppl.program.frame_inputs import stacked_inputs
from poseppl.program.observation import num_frames_of
from poseppl.runs.predictive import DataPrediction, predictive_checks
from poseppl.smoothers.inner_filter import filter_for

RHAT_ERROR, RHAT_WARNING = 1.1, 1.02
"""R-hat of a parameter's chains from which they do not agree, and from which they hardly do."""
ESS_ERROR, ESS_WARNING = 10.0, 100.0
"""Effective draws of a parameter below which its chains say nothing of it, and below which its intervals are rough."""


def predictions_under(
    model: CompiledModel,
    params: Mapping[str, ArrayLike],
    data: Observation | Mapping[str, Any],
    filter: Callable[[CompiledModel], Filter],
    rng_key: Array,
    inputs: Any = None,
    *,
    num_draws: int = 8,
) -> list[DataPrediction]:
    """Make the predictive checks of a filter under draws of the parameters.

    Args:
        model: The compiled model, with a parameters program.
        params: Draws by name, (chain, draw, ...), constrained.
        data: An Observation with a leading T, or arrays by site, NaN where nothing was seen.
        filter: `model -> filter`, such as `poseppl.kalman_filter`.
        rng_key: PRNG key.
        inputs: Inputs with a leading T, or None.
        num_draws: How many draws, evenly chosen from all chains.

    Returns:
        The checks under each, as :func:`poseppl.diagnostics.check_predictions` takes them.
    """
    check_at_least(1, num_draws=num_draws)
    observations = model.observe(data)
    check_key(rng_key)
    frames = num_frames_of(model.observation_sites, observations)
    rows = jax.tree.map(jnp.asarray, observations), stacked_inputs(inputs, frames)
    flat = {name: np.reshape(values, (-1, *np.shape(values)[2:])) for name, values in params.items()}
    chosen = np.linspace(0, len(next(iter(flat.values()))) - 1, num_draws).astype(int)
    drawn = {name: jnp.asarray(values[chosen]) for name, values in flat.items()}
    found = jax.tree.map(np.asarray, _under_all(model, filter, jax.random.split(rng_key, num_draws), drawn, rows))
    return [jax.tree.map(lambda leaf, index=index: leaf[index], found) for index in range(num_draws)]


@partial(jit, static_argnums=(0, 1))
def _under_all(model: CompiledModel, filter: Any, keys: Array, drawn: Any, rows: Any) -> DataPrediction:
    found: DataPrediction = jax.lax.map(lambda row: _predictions(model, filter, row[0], row[1], rows), (keys, drawn))
    return found


def _predictions(model: CompiledModel, filter: Any, rng_key: Array, params: Any, rows: Any) -> DataPrediction:
    bound = model.with_params(params)
    built, predict = filter_for(bound, filter), predictive_checks(bound, of_state=False)
    whole: DataPrediction = scan_filter(built, rng_key, *rows, predict=predict).prediction.data
    return whole


def check_parameters(
    params: Mapping[str, ArrayLike] | xr.DataTree, predictions: Sequence[DataPrediction] = ()
) -> list[Verdict]:
    """Judge draws of static parameters, of `pmmh`, `particle_gibbs`, or NumPyro's NUTS on `log_likelihood`.

    Args:
        params: Draws by name, (chain, draw, ...), such as `mcmc.get_samples(group_by_chain=True)` of NumPyro; or ArviZ's
            tree of them, whose posterior is judged.
        predictions: The findings of :func:`predictions_under`; mixing alone is judged without.

    Returns:
        Findings, errors first; none where no problem is detected.

    Raises:
        InputError: Draws without the dimensions (chain, draw).
    """
    by_name = getattr(params, "posterior", params)
    found = [verdict for name, draws in by_name.items() for verdict in _mixing(name, np.asarray(draws, float))]
    judged = [check_predictions(each) for each in predictions]
    wrong = [each.text for checks in judged for each in checks if each.severity == ERROR]
    if len(wrong) > len(judged) / 2:
        found.append(Verdict(ERROR, f"Under {len(wrong)} of {len(judged)} draws of the parameters: {wrong[len(wrong) // 2]}"))
    return sorted(found, key=lambda verdict: verdict.severity != ERROR)


def _mixing(name: str, draws: Any) -> Findings:
    """Agreement and effective number of the chains of one parameter."""
    if draws.ndim < 2:
        raise InputError(f"draws of shape {draws.shape}", field=name, expected="(chain, draw, ...)")
    flat = draws.reshape(*draws.shape[:2], -1)
    if not np.isfinite(flat).all():
        yield Verdict(ERROR, f"Draws of {name} are not finite: its chains went, or started, where it has no value.")
        return
    stuck = int((flat == flat[:, :1]).all((1, 2)).sum())
    if stuck and flat.shape[1] > 1:
        cure = "more warm-up, more particles or another start"
        yield Verdict(ERROR, f"{stuck} of {len(flat)} chains of {name} never moved: {cure}.")
        return
    figures = mixing(flat)
    rhat, ess = float(np.nanmax(figures.rhat, initial=1.0)), float(np.nanmin(figures.ess))
    if rhat > RHAT_WARNING:
        severity = ERROR if rhat > RHAT_ERROR else WARNING
        yield Verdict(severity, f"Chains of {name} do not agree (R-hat {rhat:.2f}): more draws, more warm-up or another start.")
    elif ess < ESS_WARNING:
        severity, result = (ERROR, "means and intervals are unusable") if ess < ESS_ERROR else (WARNING, "intervals are rough")
        yield Verdict(severity, f"Only {ess:.0f} effective draws of {name}: its {result}; take more draws.")
