"""The exact filter of hidden Markov models: programs whose state has finitely many values.

With p_t(k) = P(x_t = k | z_1..t) and the values of the state enumerated,

    p_t(k) is proportional to p(z_t | k) sum_j P(k | j) p_(t-1)(j).

Its particles are the values, the same at every frame, and their weights the probabilities: nothing is drawn, and the smoothers
that reweight particles or look for the best path through them (forward-backward, Viterbi) are then exact as well (Rabiner 1989,
doi:10.1109/5.18626).
"""

from __future__ import annotations

import itertools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from poseppl.filters.base import Filter, Info
from poseppl.filters.particle import ParticleState
from poseppl.particles.weights import normalise
from poseppl.program import CompiledModel, Observation

_MOST = 10_000


def hidden_markov_filter(model: CompiledModel) -> Filter:
    """The exact filter of hidden Markov models, whose state has finitely many values.

    Args:
        model: The compiled model; all its sites discrete, of finite support.

    Returns:
        The filter; its state is :class:`~poseppl.filters.particle.ParticleState` with all K values of the state.

    Raises:
        ValueError: A site that is continuous or unbounded, or more than 10,000 values.
    """
    values = jnp.asarray(state_values(model), jnp.result_type(float))
    count = values.shape[0]

    def weigh(log_prior: jax.Array, observation: Observation, inputs: Any) -> tuple[ParticleState, Info]:
        likelihood = jax.vmap(lambda x: model.log_observation(x, observation, inputs))(values)
        updated = normalise(log_prior + likelihood)
        log_weights = jnp.where(updated.degenerate, log_prior, updated.log_weights)
        info = Info(
            log_evidence=updated.log_mean + jnp.log(jnp.asarray(count, log_weights.dtype)),
            ess=jnp.asarray(count, log_weights.dtype),  # nothing is drawn
            ancestors=jnp.arange(count, dtype=jnp.int32),
            acceptance=jnp.ones((), log_weights.dtype),
            divergences=jnp.zeros((), jnp.int32),
            num_likelihood=jnp.asarray(count, jnp.int32),
            num_gradient=jnp.zeros((), jnp.int32),
            failed=updated.degenerate,
            step_size=jnp.full((), jnp.nan, log_weights.dtype),
        )
        return ParticleState(values.astype(log_weights.dtype), log_weights), info

    def init(rng_key: jax.Array, observation: Observation, inputs: Any = None) -> tuple[ParticleState, Info]:
        return weigh(jax.vmap(lambda x: model.log_initial(x, inputs))(values), observation, inputs)

    def step(
        rng_key: jax.Array, state: ParticleState, observation: Observation, inputs: Any = None
    ) -> tuple[ParticleState, Info]:
        def into(x: jax.Array) -> jax.Array:
            terms = jax.vmap(lambda previous: model.log_transition(x, previous, inputs))(values)
            return jax.nn.logsumexp(terms + state.log_weights)

        return weigh(jax.vmap(into)(values), observation, inputs)

    return Filter(init, step)


def state_values(model: CompiledModel) -> np.ndarray[Any, Any]:
    """All values (K, d) of a state of finitely many.

    Raises:
        ValueError: A site that is continuous or unbounded, or more than 10,000 values.
    """
    choices: list[range] = []
    for name, site in model.sites.items():
        bounds = _bounds(site.support) if site.discrete else None
        if bounds is None:
            raise ValueError(
                f"Site {name!r} has support {site.support}. Expected finitely many integers (Categorical, Bernoulli, "
                "Binomial): for others use a particle filter."
            )
        choices += [range(bounds[0], bounds[1] + 1)] * site.size
    count = int(np.prod([float(len(choice)) for choice in choices]))
    if count > _MOST:
        raise ValueError(f"The state has {count} values. Expected at most {_MOST}: use a particle filter.")
    return np.array(list(itertools.product(*choices)), float)


def _bounds(support: Any) -> tuple[int, int] | None:
    """Least and largest integer of a support, if it has them."""
    while hasattr(support, "base_constraint"):
        support = support.base_constraint
    if type(support).__name__ == "_Boolean":
        return 0, 1
    lower, upper = getattr(support, "lower_bound", None), getattr(support, "upper_bound", None)
    if lower is None or upper is None:
        return None
    return int(np.min(np.asarray(lower))), int(np.max(np.asarray(upper)))
