"""The state's sites as the programs know them: their values, their moments, and the probabilities of finite ones.

Sites over the real line are parts of the flat state, and so are their summaries. A site that takes finitely many values, such
as the state of a hidden Markov chain, has the probability of each value instead of a mean and quantiles. It is computed over
all particles or draws with their weights.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.program import CompiledModel
from poseppl.program.bijector import to_sites


def sites_of(model: CompiledModel, states: Array, inputs: Any) -> dict[str, Array]:
    """Constrained values (N, ...) by site of flat states (N, d)."""
    values = jax.vmap(lambda x: model.to_sites(x, inputs))(states)
    return {name: values[name] for name in model.sites}


def summary_of_sites(
    model: CompiledModel, of_state: Mapping[str, Array], states: Array, weights: Array | None
) -> dict[str, Array]:
    """Summaries of the sites that are parts of the flat state.

    Args:
        model: The model.
        of_state: ``state_mean`` (d,), ``state_sd`` (d,), ``state_quantile`` (quantile, d).
        states: Flat states (N, d).
        weights: Their weights (N,), which add up to 1; None where they count alike.

    Returns:
        ``NAME_probability`` (..., values) of sites of finitely many values; ``NAME_mean``, ``NAME_sd`` and ``NAME_quantile`` of
        the others.
    """
    summaries_of = {f"{name}_probability": found for name, found in site_probabilities(model, states, weights).items()}
    for name, site in model.sites.items():
        if name not in model.finite_values and site.identity and name != "state":
            summaries_of[f"{name}_mean"] = site.unflatten(of_state["state_mean"])
            summaries_of[f"{name}_sd"] = site.unflatten(of_state["state_sd"])
            summaries_of[f"{name}_quantile"] = jax.vmap(site.unflatten)(of_state["state_quantile"])
    return summaries_of


def site_probabilities(model: CompiledModel, states: Array, weights: Array | None = None) -> dict[str, Array]:
    """Probability (..., values) of each value of the sites that have finitely many; arguments as above."""
    count = states.shape[0]
    share = jnp.full(count, 1.0 / count, states.dtype) if weights is None else weights
    found = {}
    for name, values in model.finite_values.items():
        taken = jax.vmap(lambda x, name=name: to_sites({name: model.sites[name]}, x)[name])(states)
        found[name] = jnp.stack([jnp.tensordot(share, (taken == value).astype(states.dtype), 1) for value in values], -1)
    return found
