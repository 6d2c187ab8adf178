"""Collectors of what is kept of a run, which the driver calls with every frame.

A collector keeps a thinned set of draws, and the mean, standard deviation and quantiles of all draws. So thinning bounds the
memory of a long run, and intervals do not depend on it. If a filter's state has ``marginals``
(:class:`poseppl.gaussians.marginals.Marginals`), the summary of the flat state is computed from these, not from draws. Extras
(such as the markers of a body) are functions of a state, and are kept in the same way. Angles of a circular site are summarised
in the turn about their mean direction: draws on both sides of pi are near each other.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.checks import check_at_least
from poseppl.errors import InputError
from poseppl.gaussians.marginals import Marginals
from poseppl.particles.quantiles import column_quantiles, repeated_quantiles
from poseppl.particles.resampling import systematic, systematic_draws
from poseppl.particles.weights import normalise
from poseppl.program import CompiledModel
from poseppl.program.memoized_builder import memoized_builder
from poseppl.runs.gaussian_draws import Draws as Draws, GaussianCollector
from poseppl.runs.results import QUANTILES
from poseppl.runs.run import Collect
from poseppl.runs.site_summary import sites_of, summary_of_sites

Extras = Callable[[Array, Any], Mapping[str, Array]]
"""`(x, inputs) -> values by name` for one state (d,)."""

_DIMENSIONS = ("chain", "draw", "frame", "series", "state_dim", "quantile")
"""Names of results, beside those of sites."""
_NUM_QUANTILE_DRAWS = 2000
"""Weighted particles are resampled to so many draws at most for their quantiles: a standard error of 1 % of a probability."""
_COPIES = 4
"""Draws for the quantiles of a few particles, for each of them: a quarter of a particle's probability."""


@memoized_builder
def collect_draws(
    model: CompiledModel,
    *,
    max_draws: int = 200,
    extras: Extras | None = None,
    mean_only: Sequence[str] = (),
    quantiles: Sequence[float] = QUANTILES,
) -> Collect:
    """Build a collector of draws and summaries.

    Args:
        model: The model that the filter was built for.
        max_draws: How many draws are kept: at most so many of each chain (every k-th); of weighted particles exactly so many,
            resampled as one chain. Chains of unequal weights are resampled as wholes; equal ones stay as they are.
        extras: Functions of a state; the model's own deterministic sites if None.
        mean_only: Extras of which only the mean is kept.
        quantiles: Levels of the quantiles.

    Returns:
        The collector; it returns :class:`Draws`.

    Raises:
        InputError: A site has a name that results give to something else.
    """
    check_at_least(1, max_draws=max_draws)
    _check_names(model)
    of_state, levels = model.extras if extras is None else extras, jax.device_put(np.asarray(quantiles, float))

    def values_of(states: Array, inputs: Any) -> dict[str, Array]:
        """State, bent sites and extras of states (N, d), each (N, ...)."""
        sites = sites_of(model, states, inputs)
        bent = {name: value for name, value in sites.items() if not model.sites[name].identity}
        return {**jax.vmap(lambda x: of_state(x, inputs))(states), **bent, "state": states}

    summarise = partial(_summary, model, mean_only, levels)

    def draws_of(kept: dict[str, Array], summary: dict[str, Array], inputs: Any) -> Draws:
        state = kept.pop("state")
        flat = sites_of(model, state.reshape(-1, model.dimension), inputs)
        sites = {name: value.reshape(*state.shape[:2], *value.shape[1:]) for name, value in flat.items()}
        extras = {name: value for name, value in kept.items() if name not in sites}
        return Draws(state, sites, extras, summary)

    def of_chains(rng_key: Array, state: Any, inputs: Any) -> Draws:
        chains, length, dimension = state.particles.shape
        even = state.particles[systematic(rng_key, state.log_weights[:, 0], chains)]
        values = values_of(even.reshape(chains * length, dimension), inputs)
        summary = summarise(values, None, values, getattr(state, "marginals", None))
        every = -(-length // max_draws)
        kept = {
            name: value.reshape(chains, length, *value.shape[1:])[:, (length - 1) % every :: every]
            for name, value in values.items()
            if name not in mean_only
        }
        return draws_of(kept, summary, inputs)

    def of_particles(rng_key: Array, state: Any, inputs: Any) -> Draws:
        log_weights = normalise(state.log_weights).log_weights
        weights = jnp.exp(log_weights)
        # particles of no weight may hold anything
        states = jnp.where(weights[:, None] > 0, state.particles, state.particles[jnp.argmax(weights)])
        values = values_of(states, inputs)
        numbers = (min(_NUM_QUANTILE_DRAWS, _COPIES * len(states)), max_draws)
        exact, keys = getattr(state, "marginals", None), jax.random.split(rng_key)
        if exact is None or len(values) > 1:
            chosen, thinned = systematic_draws(keys, log_weights, numbers)
        else:  # whose quantiles need no draws
            chosen = thinned = systematic(keys[1], log_weights, numbers[1])
        if len(states) < len(chosen):  # each is sorted once, however often it was chosen
            summary = summarise(values, weights, values, exact, _quantiles_of_chosen(chosen, len(states)))
        else:
            summary = summarise(values, weights, {name: value[chosen] for name, value in values.items()}, exact)
        kept = {name: value[thinned][None] for name, value in values.items() if name not in mean_only}
        return draws_of(kept, summary, inputs)

    def collect(rng_key: Array, state: Any, info: Any, inputs: Any) -> Draws:
        return (of_chains if state.log_weights.ndim == 2 else of_particles)(rng_key, state, inputs)

    collect.gaussian = GaussianCollector(model, max_draws, np.asarray(quantiles, float), of_state)  # type: ignore[attr-defined]
    return collect


def _quantiles_of_chosen(chosen: Array, number: int) -> Callable[..., Array]:
    """Quantiles of the members of a sample of a size that were chosen, of which some were several times."""
    counts = jnp.zeros(number, jnp.int32).at[chosen].add(1, indices_are_sorted=True)
    return partial(repeated_quantiles, counts=counts, number=len(chosen))


def _check_names(model: CompiledModel) -> None:
    """Refuse sites that a result would mistake for one of its dimensions, or for the flat state."""
    for name, site in model.sites.items():
        taken = name in _DIMENSIONS or (name == "state" and not (site.identity and (len(model.sites) == 1 or not site.shape)))
        if taken:
            what = "the flat state of all sites" if name == "state" else "a dimension"
            raise InputError(f"a site is called {name!r}, as results call {what}", field=name, expected="another name")


def _summary(
    model: CompiledModel,
    mean_only: Sequence[str],
    levels: Array,
    values: Mapping[str, Array],
    weights: Array | None,
    sample: Mapping[str, Array],
    exact: Marginals | None,
    quantiles_of: Callable[..., Array] = column_quantiles,
) -> dict[str, Array]:
    """Summaries of values (N, ...) by name, quantiles from a sample of them; of the flat state from its moments if known."""
    values, sample = _about_direction(model, values, weights, sample)
    drawn = {name: value for name, value in values.items() if exact is None or name != "state"}
    # integers by their differences, which float32 does not round
    origins = {name: value[0] if value.dtype.kind in "iu" else jnp.zeros_like(value[0]) for name, value in drawn.items()}
    drawn = {name: value - origins[name] for name, value in drawn.items()}
    centres = {name: _average(value, weights) for name, value in drawn.items()}
    summary = {f"{name}_mean": origins[name] + centre for name, centre in centres.items()}
    # Bessel's correction where draws count alike
    count = values["state"].shape[0]
    scale = count / max(count - 1, 1) if weights is None else 1.0
    spread = {name: value for name, value in drawn.items() if name not in mean_only}
    for name, value in spread.items():
        summary[f"{name}_sd"] = jnp.sqrt(scale * _average(jnp.square(value - centres[name]), weights))
    between = _quantiles({name: sample[name] for name in spread}, levels, quantiles_of)
    if exact is not None:
        between["state"] = exact.quantiles(levels)
        summary |= {"state_mean": exact.mean, "state_sd": exact.standard_deviation}
    summary |= {f"{name}_quantile": value for name, value in between.items()}
    of_states = (values["state"], weights) if exact is None else (exact.means, jnp.exp(exact.log_weights))
    return summary | summary_of_sites(model, summary, *of_states)


def _about_direction(
    model: CompiledModel, values: Mapping[str, Array], weights: Array | None, sample: Mapping[str, Array]
) -> tuple[Mapping[str, Array], Mapping[str, Array]]:
    """Values and the sample of them, whose states have their angles within half a turn of the mean direction."""
    circular = np.asarray(model.circular_coordinates)
    if not circular.any():
        return values, sample
    states, turn = values["state"], 2 * jnp.pi
    direction = jnp.arctan2(_average(jnp.sin(states), weights), _average(jnp.cos(states), weights))
    direction = direction + turn * jnp.round((_average(states, weights) - direction) / turn)

    def about(x: Array) -> Array:
        return jnp.where(circular, direction + (x - direction + jnp.pi) % turn - jnp.pi, x)

    return {**values, "state": about(states)}, {**sample, "state": about(sample["state"])}


def _average(values: Array, weights: Array | None) -> Array:
    return jnp.mean(values, 0) if weights is None else jnp.tensordot(weights, values, 1)


def _quantiles(sample: Mapping[str, Array], levels: Array, quantiles_of: Callable[..., Array]) -> dict[str, Array]:
    """Quantiles (levels, ...) of each array (N, ...), all of them side by side."""
    if not sample:
        return {}
    sizes = [value[0].size for value in sample.values()]
    together = jnp.concatenate([value.reshape(value.shape[0], -1).astype(float) for value in sample.values()], 1)
    parts = jnp.split(quantiles_of(together, levels=levels), np.cumsum(sizes)[:-1], axis=1)
    return {
        name: part.reshape(len(levels), *value.shape[1:]) for (name, value), part in zip(sample.items(), parts, strict=True)
    }
