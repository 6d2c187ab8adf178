"""The exact filter of hidden Markov models: programs whose state has finitely many values.

With p_t(k) = P(x_t = k | z_1..t) and the values of the state enumerated,

    p_t(k) is proportional to p(z_t | k) sum_j P(k | j) p_(t-1)(j).

Its particles are the values, the same at every frame, and their weights the probabilities: nothing is drawn, and the smoothers
that reweight particles or look for the best path through them (forward-backward, Viterbi) are then exact as well (Rabiner 1989,
doi:10.1109/5.18626).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.checks import check_choice
from poseppl.filters.base import Filter, FilterInfo, filter_info
from poseppl.filters.in_parallel import Schedule, wants_parallel
from poseppl.filters.sequential_monte_carlo import ParticleState
from poseppl.particles.stacks import prepend, tree_index
from poseppl.particles.weights import Weighed, weigh
from poseppl.program import CompiledModel, Observation
from poseppl.program.bijector import integer_bounds as integer_bounds
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.population import log_initials, log_likelihoods, log_transition_matrix

_MAX = 10_000
_MAX_AT_ONCE = 2**22
"""Numbers of the densities of all frames up to which they are computed before the loop over frames."""
_MAX_IN_PARALLEL = 64
"""Values of a state up to which frames are run in parallel by themselves."""


@memoized_builder
def hidden_markov_filter(model: CompiledModel, *, schedule: Schedule = "auto") -> Filter:
    """The exact filter of hidden Markov models, whose state has finitely many values.

    Args:
        model: The compiled model; all its sites discrete, of finite support.
        schedule: How `scan_filter` and `log_likelihood` run frames: "parallel" in time, with K^3 operations a frame, one after
            the other, or "auto", parallel on a GPU or TPU for K up to 64. `infer` runs them one after the other.

    Returns:
        The filter; its state is :class:`~poseppl.filters.sequential_monte_carlo.ParticleState` with all K values of the state.

    Raises:
        ValueError: A site that is continuous or unbounded, or more than 10,000 values.
    """
    check_choice(Schedule, schedule=schedule)
    values = jnp.asarray(state_values(model), jnp.result_type(float))
    count = values.shape[0]

    def update(log_prior: Array, observation: Observation, inputs: Any) -> tuple[ParticleState, FilterInfo]:
        weighed = weigh(log_prior, log_likelihoods(model, values, observation, inputs))
        # nothing is drawn: the ESS is the number of values
        info = filter_info(weighed.log_evidence, count, count, weighed.failed, num_likelihood=count)
        return ParticleState(values.astype(weighed.log_weights.dtype), weighed.log_weights), info

    def init(rng_key: Array, observation: Observation, inputs: Any = None) -> tuple[ParticleState, FilterInfo]:
        return update(log_initials(model, values, inputs), observation, inputs)

    def step(
        rng_key: Array, state: ParticleState, observation: Observation, inputs: Any = None
    ) -> tuple[ParticleState, FilterInfo]:
        terms = log_transition_matrix(model, values, values, inputs) + state.log_weights
        return update(jax.nn.logsumexp(terms, axis=1), observation, inputs)

    def in_parallel(keys: Array, observations: Observation, stacked: Callable[[], Any]) -> Any:
        if not wants_parallel(schedule, count <= _MAX_IN_PARALLEL):
            return _one_after_the_other(model, values, observations, stacked())
        inputs = stacked()
        frames = jnp.arange(len(keys)), inputs
        moves = jax.vmap(lambda _, row: log_transition_matrix(model, values, values, row))(*frames)
        densities = jax.vmap(lambda observation, row: log_likelihoods(model, values, observation, row))(observations, inputs)
        first = log_initials(model, values, tree_index(inputs, 0))
        predicted = _predictions(first, moves, densities)
        return jax.vmap(update)(predicted, observations, inputs)

    return Filter(init, step, in_parallel=in_parallel, closed_form=True)


def _one_after_the_other(
    model: CompiledModel, values: Array, observations: Observation, inputs: Any
) -> tuple[ParticleState, FilterInfo] | None:
    """States and diagnoses of T frames; None where the densities of all of them are many.

    The densities are computed for all frames at once, and the loop over frames is left with the recursion.
    """
    later = tree_index(inputs, slice(1, None))
    varies, count = bool(jax.tree.leaves(inputs)), len(values)
    of_data = sum(leaf.size for leaf in jax.tree.leaves(observations.values))
    num_frames = len(jax.tree.leaves(observations)[0])
    if count * max(of_data, num_frames * (count if varies else 1)) > _MAX_AT_ONCE:
        return None
    densities = jax.vmap(lambda observation, row: log_likelihoods(model, values, observation, row))(observations, inputs)

    def move(row: Any) -> Array:
        return log_transition_matrix(model, values, values, row)

    moves = jax.vmap(move)(later) if varies else move(inputs)

    @partial(jax.checkpoint, prevent_cse=False)
    def advance(log_weights: Array, row: tuple[Array, Any]) -> tuple[Array, Weighed]:
        density, own = row
        weighed = weigh(jax.nn.logsumexp((own if varies else moves) + log_weights, axis=1), density)
        return weighed.log_weights, weighed

    first = weigh(log_initials(model, values, tree_index(inputs, 0)), densities[0])
    rest = jax.lax.scan(advance, first.log_weights, (densities[1:], moves if varies else None))[1]
    weighed = prepend(first, rest)
    states = jnp.broadcast_to(values.astype(densities.dtype), (num_frames, *values.shape))
    info = jax.vmap(lambda each: filter_info(each.log_evidence, count, count, each.failed, num_likelihood=count))(weighed)
    return ParticleState(states, weighed.log_weights), info


def _predictions(first: Array, moves: Array, densities: Array) -> Array:
    """Log-probabilities (T, K) of each frame's values given the data before it.

    Args:
        first: Those of the first frame (K,).
        moves: log P(k | j) into each frame (T, K, K), at [t, k, j]; the first one means nothing.
        densities: log p(z_t | k), (T, K).
    """
    start = jnp.broadcast_to(first[:, None], moves.shape[1:])
    elements = jnp.concatenate([start[None], moves[1:]]) + densities[:, :, None]
    ends = jax.lax.associative_scan(jax.vmap(_join), elements)[:-1, :, 0]
    filtered = jax.nn.log_softmax(ends, axis=1)
    return jnp.concatenate([first[None], jax.nn.logsumexp(moves[1:] + filtered[:, None, :], axis=2)])


def _join(earlier: Array, later: Array) -> Array:
    """Product of two elements (K, K), [to, from], up to a factor, of which normalised values know nothing."""
    product = jax.nn.logsumexp(later[:, :, None] + earlier[None], axis=1)
    peak = jax.lax.stop_gradient(jnp.max(product))
    return product - jnp.where(jnp.isfinite(peak), peak, 0.0)


def state_values(model: CompiledModel) -> np.ndarray[Any, Any]:
    """All flat states (K, d), where they are finitely many.

    Raises:
        ValueError: A site that is continuous or unbounded, or more than 10,000 values.
    """
    choices: list[range] = []
    for name, site in model.sites.items():
        bounds = integer_bounds(site.support) if site.discrete else None
        if bounds is None:
            raise ValueError(
                f"Site {name!r} has support {site.support}. Expected finitely many integers (Categorical, Bernoulli, "
                "Binomial): for others use a particle filter."
            )
        choices += [range(bounds[0], bounds[1] + 1)] * math.prod(site.shape)
    count = int(np.prod([float(len(choice)) for choice in choices]))
    if count > _MAX:
        raise ValueError(f"The state has {count} values. Expected at most {_MAX}: use a particle filter.")
    table = np.array(list(itertools.product(*choices)))
    if not any(site.split for site in model.sites.values()):
        return table.astype(float)
    stops = np.cumsum([math.prod(site.shape) for site in model.sites.values()])[:-1]
    parts = zip(model.sites.values(), np.split(table, stops, axis=1), strict=True)
    values = {site.name: part.reshape(count, *site.shape).astype(site.dtype) for site, part in parts}
    with jax.ensure_compile_time_eval():
        return np.asarray(jax.vmap(model.to_flat)(values))
