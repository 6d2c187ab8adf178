"""A hidden Markov model with finitely many states and symbols, which the forward-backward algorithm solves exactly.

    P(k_0 = i) = initial_i,    P(k_t = j | k_(t-1) = i) = transition_ij,    P(y_t = s | k_t = i) = emission_is

State site `k` and data site `y`, integers; no inputs.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist

from poseppl.program import StateSpaceModel


def finite_hmm(initial: Any = None, transition: Any = None, emission: Any = None) -> StateSpaceModel:
    """Build the model; by default two sticky states and three symbols.

    Args:
        initial: Probabilities (K,).
        transition: Probabilities (K, K), rows sum to one.
        emission: Probabilities (K, S), rows sum to one.

    Raises:
        ValueError: Shapes that do not fit, or rows that do not sum to one.
    """
    first = np.asarray([0.6, 0.4] if initial is None else initial, float)
    move = np.asarray([[0.9, 0.1], [0.2, 0.8]] if transition is None else transition, float)
    emit = np.asarray([[0.7, 0.2, 0.1], [0.1, 0.3, 0.6]] if emission is None else emission, float)
    count = first.shape[0]
    if move.shape != (count, count) or emit.ndim != 2 or emit.shape[0] != count:
        raise ValueError(f"transition {move.shape} and emission {emit.shape} do not fit {count} states.")
    for name, rows in (("initial", first), ("transition", move), ("emission", emit)):
        if np.any(rows < 0) or not np.allclose(rows.sum(-1), 1.0):
            raise ValueError(f"{name} has rows that are no probabilities. Expected rows that are positive and sum to one.")

    def start(params: Any, inputs: Any) -> None:
        numpyro.sample("k", dist.Categorical(probs=jnp.asarray(first)))

    def step(params: Any, state: dict[str, Any], inputs: Any) -> None:
        numpyro.sample("k", dist.Categorical(probs=jnp.asarray(move)[state["k"]]))

    def observe(params: Any, state: dict[str, Any], inputs: Any) -> None:
        numpyro.sample("y", dist.Categorical(probs=jnp.asarray(emit)[state["k"]]))

    return StateSpaceModel(start, step, observe)
