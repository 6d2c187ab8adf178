"""The hidden Markov chain of a model: a finite site, and the site whose law it decides.

    k_t ~ A[k_(t-1)],    f_t ~ p(f | k_t) of mean mu_k and covariance Sigma_k,

beside sites that have nothing to do with either. Read off the transition program, so that it may change with the inputs.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.errors import UnsuitableModelError
from poseppl.program.bijector import Site
from poseppl.program.compiled import CompiledModel
from poseppl.program.execution import trace_program
from poseppl.program.moments import moments


class ChainSites(NamedTuple):
    """The sites of a chain: the finite one, of K values from 0 on, and the one that it emits, of e coordinates."""

    finite: Site
    emission: Site
    num_values: int


class HiddenChain(NamedTuple):
    """A chain at one frame: `transition` probabilities (K, K), `means` (K, e), `covariances` (K, e, e)."""

    transition: Array
    means: Array
    covariances: Array


def chain_sites(model: CompiledModel, inputs: Any = None) -> ChainSites | None:
    """Find a model's chain; None where it has no finite site.

    Raises:
        UnsuitableModelError: It has several finite sites, or one that is no scalar from 0 to K - 1 or decides not just one
            other site.
    """
    if not model.finite_sites:
        return None
    finite = model.sites[model.finite_sites[0]]
    state = jnp.zeros(model.dimension)
    depends = model.same_frame_dependence("transition", inputs, state)
    emitted = [name for name, others in depends.items() if finite.name in others]
    trace = _trace(model, state, inputs, {})
    values = _num_values(trace[finite.name]["fn"])
    if len(model.finite_sites) > 1 or finite.shape or values is None or len(emitted) != 1:
        raise UnsuitableModelError(
            f"The model has the finite sites {list(model.finite_sites)}, and {finite.name!r} decides {emitted}. Expected one "
            "Categorical site that decides one other site, which it emits."
        )
    return ChainSites(finite, model.sites[emitted[0]], values)


def hidden_chain(model: CompiledModel, sites: ChainSites, x_previous: Array, inputs: Any = None) -> HiddenChain:
    """The chain at a frame.

    Args:
        model: The compiled model.
        sites: Its chain's sites.
        x_previous: A state (d,) at the frame before; only its finite site is changed, and no other should matter.
        inputs: The inputs of the frame.
    """
    numbers = jnp.arange(sites.num_values)

    def row(value: Array) -> Array:
        before = x_previous.at[sites.finite.offset].set(value.astype(x_previous.dtype))
        law = _trace(model, before, inputs, {})[sites.finite.name]["fn"]
        return jnp.exp(jax.vmap(law.log_prob)(numbers))

    def emission(value: Array) -> tuple[Array, Array]:
        trace = _trace(model, x_previous, inputs, {sites.finite.name: value.astype(sites.finite.dtype)})
        mean, spread = moments(trace[sites.emission.name]["fn"])
        return mean, jnp.diag(spread) if spread.ndim == 1 else spread

    return HiddenChain(jax.vmap(row)(numbers), *jax.vmap(emission)(numbers))


def _trace(model: CompiledModel, x_previous: Array, inputs: Any, values: dict[str, Array]) -> Any:
    return trace_program(model.programs.transition, model._arguments(inputs, x_previous), values=values)


def _num_values(law: Any) -> int | None:
    """Number of values of a Categorical law; None of others."""
    parameters = getattr(law, "probs", None)
    return None if parameters is None or jnp.ndim(parameters) != 1 else int(parameters.shape[-1])
