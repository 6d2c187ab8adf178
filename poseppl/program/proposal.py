"""Proposals of a user as NumPyro programs: where to look for a frame's state once its data are known.

    initial(params, inputs, observation)            samples the state's sites at the first frame
    transition(params, state, inputs, observation)  samples them at a later frame, given the state before it

`observation` is the frame's :class:`~poseppl.program.observation.Observation`: values by site, and masks of what was seen. The
programs sample the same sites as the model's own, of the same shapes and over the same supports.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.program import bijector, schema
from poseppl.program.clamped import ClampedModel
from poseppl.program.compiled import CompiledModel
from poseppl.program.execution import draw, log_density
from poseppl.program.observation import Observation


class Proposal(NamedTuple):
    """Programs that propose a frame's state.

    Attributes:
        transition: `(params, state, inputs, observation)`.
        initial: `(params, inputs, observation)`; the model's own initial program if None.
    """

    transition: Callable[[Any, dict[str, Any], Any, Observation], Any]
    initial: Callable[[Any, Any, Observation], Any] | None = None


class Proposing(NamedTuple):
    """One program with its data: draws and log-densities of flat states.

    Attributes:
        sample: `(rng_key, *state) -> x`; `state` is the flat state before, at later frames.
        log_density: `(x, *state) -> scalar`.
    """

    sample: Callable[..., Array]
    log_density: Callable[..., Array]


def propose_initial(model: CompiledModel, proposal: Proposal, observation: Observation, inputs: Any) -> Proposing:
    """The proposal of the first frame."""
    if proposal.initial is None:
        return Proposing(lambda rng_key: model.sample_initial(rng_key, inputs), lambda x: model.log_initial(x, inputs))
    return _proposing(model, "proposal initial", proposal.initial, (inputs, observation), before=False)


def propose_transition(model: CompiledModel, proposal: Proposal, observation: Observation, inputs: Any) -> Proposing:
    """The proposal of a later frame."""
    return _proposing(model, "proposal transition", proposal.transition, (inputs, observation), before=True)


def _proposing(model: CompiledModel, which: str, program: Any, known: tuple[Any, ...], *, before: bool) -> Proposing:
    """Check a program against the model's sites, and make pure functions of it.

    Raises:
        ValueError: A missing, extra or misshapen site, or a clamped model.
    """
    if isinstance(model, ClampedModel):
        raise ValueError("A proposal program samples whole states, and the model is clamped: leave proposal= out.")
    shapes = jax.tree.map(lambda leaf: np.zeros(jnp.shape(leaf), jnp.result_type(leaf)), known)
    example = ({name: np.zeros(site.shape, site.dtype) for name, site in model.sites.items()},) if before else ()
    declared = schema.declare(which, program, (model.params, *example, *shapes), model.sites)
    schema.check_transition(model.sites, declared)

    def arguments(state: tuple[Array, ...]) -> tuple[Any, ...]:
        return (model.params, *(bijector.to_sites(model.sites, x) for x in state), *known)

    def sample(rng_key: Array, *state: Array) -> Array:
        return model.to_flat(draw(program, arguments(state), rng_key, declared.randomness))

    def log_proposal(x: Array, *state: Array) -> Array:
        sites = bijector.to_sites(model.sites, x)
        return log_density(program, arguments(state), sites) + bijector.log_det(model.sites, x)

    return Proposing(sample, log_proposal)
