"""Draw a trajectory and its data from a model: ancestral sampling, frame by frame.

x_0 ~ p(x_0),   x_t ~ p(x_t | x_t-1),   z_t ~ p(z_t | x_t)
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_at_least, check_key
from poseppl.compilation import jit
from poseppl.particles.stacks import tree_index
from poseppl.program import CompiledModel, Observation
from poseppl.program.earlier_data import EarlierDataModel
from poseppl.program.earlier_inputs import at_frame, following
from poseppl.program.large_integers import check_exact
from poseppl.runs.frame_sequence import stacked_inputs


class Simulation(NamedTuple):
    """A trajectory of flat states (T, d), and the data sites by name, each with a leading T."""

    states: Array
    values: dict[str, Array]


def simulate(model: CompiledModel, rng_key: Array, num_frames: int, inputs: Any = None) -> Simulation:
    """Draw states and data of a sequence.

    Args:
        model: The compiled model.
        rng_key: PRNG key.
        num_frames: T, at least 1.
        inputs: Inputs with a leading T, constant parts wrapped in :class:`~poseppl.runs.run.Constant`; None where the model
            takes none.

    Returns:
        The flat states and the data, ready for ``model.observe``.

    Raises:
        ValueError: `num_frames` is below 1, or an array of the inputs does not have T rows.
        PosepplError: An integer of the state reaches what float32 does not hold.
    """
    check_at_least(1, num_frames=num_frames)
    check_key(rng_key)
    keys = jax.random.split(rng_key, (num_frames, 2))
    states, values = _draw_sequence(model, keys, stacked_inputs(inputs, num_frames))
    check_exact(model.sites, states)
    return Simulation(states, values)


def draw_sequence(model: CompiledModel, keys: Array, inputs: Any) -> tuple[Array, dict[str, Array]]:
    """States (T, d) and data by site (T, ...), from keys (T, 2); pure, to be vmapped and jitted."""
    if isinstance(model, EarlierDataModel):
        return _draw_with_data(model, keys, inputs)
    first = model.sample_initial(keys[0, 0], tree_index(inputs, 0))

    def advance(x: Array, row: Any) -> tuple[Array, Array]:
        key, inputs = row
        x = model.sample_transition(key, x, inputs)
        return x, x

    later = tree_index(inputs, slice(1, None))
    _, rest = jax.lax.scan(advance, first, (keys[1:, 0], later))
    states = jnp.concatenate([first[None], rest])
    return states, jax.vmap(model.sample_observation)(keys[:, 1], states, inputs)


def _draw_with_data(model: CompiledModel, keys: Array, inputs: Any) -> tuple[Array, dict[str, Array]]:
    """The same where earlier data are predictors: a frame's data are drawn before the next frame."""

    def observed(key: Array, x: Array, given: Any) -> tuple[Any, tuple[Array, dict[str, Array]]]:
        values = model.sample_observation(key, x, given)
        seen = {name: jnp.ones(value.shape, bool) for name, value in values.items()}
        return (x, following(model, given, Observation(values, seen))), (x, values)

    def advance(carried: Any, row: Any) -> Any:
        (x, before), (key, frame) = carried, row
        given = at_frame(model, frame, before)
        return observed(key[1], model.sample_transition(key[0], x, given), given)

    given = at_frame(model, tree_index(inputs, 0), None)
    carried, first = observed(keys[0, 1], model.sample_initial(keys[0, 0], given), given)
    _, rest = jax.lax.scan(advance, carried, (keys[1:], tree_index(inputs, slice(1, None))))
    drawn: tuple[Array, dict[str, Array]] = jax.tree.map(lambda one, more: jnp.concatenate([one[None], more]), first, rest)
    return drawn


_draw_sequence = jit(draw_sequence, static_argnums=0)
