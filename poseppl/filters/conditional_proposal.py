r"""Proposals for states of finite and real sites: the finite ones from the program, the real ones linearised given them.

With a state (k, x), k finite, the proposal is

    q(k, x | k', x', z_t) = p(k | k', x') q(x | k, k', x', z_t),

the second factor a local linearisation (:mod:`poseppl.filters.local_proposal`) of the model whose finite sites are clamped. Its
density against the transition's is p(x | k, k', x') / q(x | k, k', x', z_t): the finite sites' probabilities cancel.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.errors import UnsuitableModelError
from poseppl.filters.local_proposal import local_proposal
from poseppl.program import Clamped, CompiledModel, Observation
from poseppl.program.clamped import ClampedModel, clamp
from poseppl.program.population import draw_initial, log_initials, log_transitions, propagate


def conditional_draw(
    model: CompiledModel, keys: Array, previous: Array | None, observation: Observation, inputs: Any
) -> tuple[Array, Array]:
    """Draw states (N, d), with their log-densities (N,) under the proposal.

    Args:
        model: The compiled model, with finite sites that depend on no real site of their frame.
        keys: Keys (N,).
        previous: States before (N, d), one for each; None at the first frame.
        observation: The frame's data.
        inputs: The frame's inputs.

    Raises:
        UnsuitableModelError: The model has no real site, a clamped one, or its finite sites depend on real ones of their frame.
    """
    real = conditional_model(model)
    columns = np.flatnonzero(~np.asarray(model.finite_coordinates))
    which = "initial" if previous is None else "transition"
    _check_order(model, which, previous, inputs)
    pairs: Any = jax.vmap(jax.random.split)(keys)
    first = pairs[:, 0]
    drawn = draw_initial(model, first, inputs) if previous is None else propagate(model, first, previous, inputs)

    def one(key: Array, drawn: Array, before: Array) -> tuple[Array, Array, Array]:
        given = Clamped(inputs, drawn, before)

        def moments(x: Array) -> tuple[Array, Array]:
            return real.initial_moments(given) if previous is None else real.transition_moments(x, given)

        local = local_proposal(real, moments, before[columns][None], observation, given)
        noise = jax.random.normal(key, (len(columns),), drawn.dtype)
        scale = local.scales if local.scales.ndim == 2 else local.scales[0]
        x = local.means[0] + scale @ noise
        log_det = jnp.ravel(local.log_det)[0]
        log_proposal = -0.5 * jnp.sum(noise**2) - log_det - 0.5 * len(columns) * jnp.log(2 * jnp.pi)
        log_prior = real.log_initial(x, given) if previous is None else real.log_transition(x, before[columns], given)
        return drawn.at[columns].set(x), log_proposal, log_prior

    before = jnp.zeros_like(drawn) if previous is None else previous
    states, log_proposal, log_real = jax.vmap(one)(pairs[:, 1], drawn, before)
    whole = log_initials(model, states, inputs) if previous is None else log_transitions(model, states, before, inputs)
    # the finite sites' probabilities cancel, but not their derivative: a draw of them has none of its own
    return states, jax.lax.stop_gradient(whole - log_real) + log_proposal


def conditional_model(model: CompiledModel) -> ClampedModel:
    """The model of the real sites, the finite ones given.

    Raises:
        UnsuitableModelError: There is no real site, or the model is clamped already.
    """
    real = [name for name in model.sites if name not in model.finite_sites]
    if not real or isinstance(model, ClampedModel):
        what = "is clamped" if real else "has finite sites alone"
        raise UnsuitableModelError(f"The model {what}: its finite sites cannot be given for a proposal. Use a particle filter.")
    return clamp(model, real)


def _check_order(model: CompiledModel, which: str, previous: Array | None, inputs: Any) -> None:
    """Refuse finite sites that depend on real ones of their frame: given these, they would have other probabilities."""
    for name in model.finite_sites:
        others = model.same_frame_dependence(which, inputs, None if previous is None else previous[0])[name]
        found = [other for other in others if other not in model.finite_sites]
        if found:
            raise UnsuitableModelError(
                f"The finite site {name!r} of the {which} program depends on {found[0]!r} of its frame. Sample it first, or "
                "use a particle or tempered filter."
            )
