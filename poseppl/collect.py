"""What is kept of a run: collectors, which the driver calls with every frame.

Kept are a thinning of the draws and, made over all of them, their mean, standard deviation and quantiles; so the memory of a
long run is bounded by the thinning, and its intervals do not depend on it. Extras (such as the markers of a body) are functions
of a state, and are kept in the same way.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from poseppl.checks import check_at_least
from poseppl.program import CompiledModel
from poseppl.resampling import systematic
from poseppl.results import QUANTILES
from poseppl.run import Collect
from poseppl.weights import normalise

Extras = Callable[[jax.Array, Any], Mapping[str, jax.Array]]
"""`(x, inputs) -> values by name` for one state (d,)."""

_NUM_QUANTILE_DRAWS = 2000
"""Weighted particles are resampled to so many draws for their quantiles: a standard error of 1 % of a probability."""


class Draws(NamedTuple):
    """What is kept of a frame.

    Attributes:
        state: Draws (chains, draws, d).
        extras: Draws of the extras by name (chains, draws, ...).
        summary: ``state_mean``, ``state_sd``, ``state_quantile`` (quantile, d), and the same of the extras, by name.
    """

    state: jax.Array
    extras: dict[str, jax.Array]
    summary: dict[str, jax.Array]


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
        max_draws: How many draws are kept, of each chain (every k-th), or of all weighted particles (resampled, as one chain).
        extras: Functions of a state; the model's own deterministic sites if None.
        mean_only: Extras of which only the mean is kept.
        quantiles: Levels of the quantiles.

    Returns:
        The collector; it returns :class:`Draws`.
    """
    check_at_least(1, max_draws=max_draws)
    of_state = model.extras if extras is None else extras
    levels = jnp.asarray(quantiles)

    def values_of(states: jax.Array, inputs: Any) -> dict[str, jax.Array]:
        """State and extras of states (N, d), each (N, ...)."""
        return {"state": states, **jax.vmap(lambda x: of_state(x, inputs))(states)}

    def summarise(name: str, values: jax.Array, weights: jax.Array | None, sample: jax.Array) -> dict[str, jax.Array]:
        mean = _average(values, weights)
        if name in mean_only:
            return {f"{name}_mean": mean}
        # Bessel's correction where draws count alike
        count = values.shape[0]
        scale = count / max(count - 1, 1) if weights is None else 1.0
        spread = jnp.sqrt(scale * _average(jnp.square(values - mean), weights))
        return {f"{name}_mean": mean, f"{name}_sd": spread, f"{name}_quantile": _quantiles(sample, levels)}

    def of_chains(state: Any, inputs: Any) -> Draws:
        chains, length, dimension = state.particles.shape
        values = values_of(state.particles.reshape(chains * length, dimension), inputs)
        summary: dict[str, jax.Array] = {}
        for name, value in values.items():
            summary |= summarise(name, value, None, value)
        every = -(-length // max_draws)
        kept = {
            name: value.reshape(chains, length, *value.shape[1:])[:, (length - 1) % every :: every]
            for name, value in values.items()
            if name not in mean_only
        }
        return Draws(kept.pop("state"), kept, summary)

    def of_particles(rng_key: jax.Array, state: Any, inputs: Any) -> Draws:
        key_sample, key_kept = jax.random.split(rng_key)
        log_weights = normalise(state.log_weights).log_weights
        weights = jnp.exp(log_weights)
        # particles of no weight may hold anything
        states = jnp.where(weights[:, None] > 0, state.particles, state.particles[jnp.argmax(weights)])
        values = values_of(states, inputs)
        chosen = systematic(key_sample, log_weights, min(_NUM_QUANTILE_DRAWS, max(states.shape[0], 1)))
        thinned = systematic(key_kept, log_weights, min(max_draws, states.shape[0]))
        summary: dict[str, jax.Array] = {}
        for name, value in values.items():
            summary |= summarise(name, value, weights, value[chosen])
        kept = {name: value[thinned][None] for name, value in values.items() if name not in mean_only}
        return Draws(kept.pop("state"), kept, summary)

    def collect(rng_key: jax.Array, state: Any, info: Any, inputs: Any) -> Draws:
        return of_chains(state, inputs) if state.particles.ndim == 3 else of_particles(rng_key, state, inputs)

    return collect


def _average(values: jax.Array, weights: jax.Array | None) -> jax.Array:
    return jnp.mean(values, 0) if weights is None else jnp.tensordot(weights, values, 1)


def _quantiles(sample: jax.Array, levels: jax.Array) -> jax.Array:
    """Quantiles (levels, ...) of a sample (N, ...), interpolated between its order statistics."""
    ordered = jnp.sort(jnp.moveaxis(sample, 0, -1), axis=-1)
    place = levels * (sample.shape[0] - 1)
    below = jnp.floor(place).astype(jnp.int32)
    above = jnp.minimum(below + 1, sample.shape[0] - 1)
    fraction = (place - below).astype(sample.dtype)
    between = ordered[..., below] * (1 - fraction) + ordered[..., above] * fraction
    return jnp.moveaxis(between, -1, 0)
