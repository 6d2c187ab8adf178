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
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.filters.base import Filter, FilterInfo, filter_info
from poseppl.filters.sequential_monte_carlo import ParticleState
from poseppl.particles.weights import weigh
from poseppl.program import CompiledModel, Observation
from poseppl.program.bijector import integer_bounds as integer_bounds
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.population import log_initials, log_likelihoods, log_transition_matrix

_MAX = 10_000


@memoized_builder
def hidden_markov_filter(model: CompiledModel) -> Filter:
    """The exact filter of hidden Markov models, whose state has finitely many values.

    Args:
        model: The compiled model; all its sites discrete, of finite support.

    Returns:
        The filter; its state is :class:`~poseppl.filters.sequential_monte_carlo.ParticleState` with all K values of the state.

    Raises:
        ValueError: A site that is continuous or unbounded, or more than 10,000 values.
    """
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

    return Filter(init, step, closed_form=True)


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
