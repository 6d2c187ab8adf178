"""Clamping: the model of some coordinates, with all the others given frame by frame.

With the free coordinates f and the clamped ones c, the densities are the full model's at the full state,

    p(f_t, c_t | f_t-1, c_t-1)   and   p(z_t | f_t, c_t),

as functions of f. Samplers draw the full state and keep f, that is they draw from p(f_t | x_t-1): densities and draws agree
(up to the constant p(c_t | x_t-1)) exactly when c_t and f_t are independent given x_t-1, as in a random walk with a diagonal
covariance. Where they are not, importance weights that take a draw's density for granted are approximate.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from poseppl.program.compiled import CompiledModel, Inputs
from poseppl.program.observation import Observation
from poseppl.program.prediction import DrawnData


class Clamped(NamedTuple):
    """Inputs of a clamped model at one frame.

    Attributes:
        inputs: The full model's inputs.
        values: Full flat state (d_full,) of this frame; its free entries are not read.
        previous: Full flat state (d_full,) of the frame before; not read at the first frame.
    """

    inputs: Any
    values: jax.Array
    previous: jax.Array

    @classmethod
    def of_trajectory(cls, values: Any, inputs: Any = None) -> Clamped:
        """Stacked inputs for a whole sequence, from full flat states (T, d_full) and the full model's inputs."""
        states = jnp.asarray(values)
        return cls(inputs, states, jnp.concatenate([states[:1], states[:-1]]))


class _Run(NamedTuple):
    """Consecutive entries of one vector: `size` of them, from `start` on."""

    free: bool
    start: int
    size: int


@dataclasses.dataclass(frozen=True, eq=False)
class ClampedModel(CompiledModel):
    """The model of the coordinates `free` of a full model; every `inputs` is a `Clamped`.

    It has the interface of a `CompiledModel`, so every algorithm takes it. `to_sites` and `log_det` need the inputs as well.

    Attributes:
        full: The full model.
        free: Indices of the free coordinates, in the order of this model's flat state.
    """

    full: CompiledModel = None  # type: ignore[assignment]
    free: tuple[int, ...] = ()

    @property
    def dimension(self) -> int:
        """Number of free coordinates."""
        return len(self.free)

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the free coordinates."""
        names = self.full.coordinate_names
        return tuple(names[index] for index in self.free)

    def with_params(self, params: Any) -> ClampedModel:
        """The same model with other params."""
        return _clamped(self.full.with_params(params), self.free)

    @property
    def _constant_noise(self) -> dict[str, Any]:
        return self.full._constant_noise

    def fill(self, x: jax.Array, values: jax.Array) -> jax.Array:
        """The full state (d_full,): free entries from `x`, the others from `values`; slices only, no scatter."""
        place = {index: position for position, index in enumerate(self.free)}
        runs = _runs([(True, place[i]) if i in place else (False, i) for i in range(self.full.dimension)])
        return jnp.concatenate([(x if r.free else values)[r.start : r.start + r.size].astype(x.dtype) for r in runs])

    def _keep(self, full: jax.Array, axis: int = 0) -> jax.Array:
        runs = _runs([(True, index) for index in self.free])
        return jnp.concatenate([jax.lax.slice_in_dim(full, r.start, r.start + r.size, axis=axis) for r in runs], axis)

    def to_sites(self, x: jax.Array, inputs: Inputs = None) -> dict[str, jax.Array]:
        """Constrained values of all sites of the full state."""
        return self.full.to_sites(self.fill(x, _required(inputs).values))

    def to_flat(self, sites: Mapping[str, Any]) -> jax.Array:
        """The free coordinates of a full state given by its sites."""
        return self._keep(self.full.to_flat(sites))

    def log_det(self, x: jax.Array, inputs: Inputs = None) -> jax.Array:
        """Log-determinant of the full chart."""
        return self.full.log_det(self.fill(x, _required(inputs).values))

    def sample_initial(self, rng_key: jax.Array, inputs: Inputs = None) -> jax.Array:
        """Draw a full first state and keep its free coordinates."""
        return self._keep(self.full.sample_initial(rng_key, _required(inputs).inputs))

    def log_initial(self, x: jax.Array, inputs: Inputs = None) -> jax.Array:
        """Full log-density of the first state."""
        return self.full.log_initial(self.fill(x, _required(inputs).values), inputs.inputs)

    def sample_transition(self, rng_key: jax.Array, x_previous: jax.Array, inputs: Inputs = None) -> jax.Array:
        """Draw a full next state and keep its free coordinates."""
        previous = self.fill(x_previous, _required(inputs).previous)
        return self._keep(self.full.sample_transition(rng_key, previous, inputs.inputs))

    def log_transition(self, x: jax.Array, x_previous: jax.Array, inputs: Inputs = None) -> jax.Array:
        """Full log-density of the transition."""
        previous = self.fill(x_previous, _required(inputs).previous)
        return self.full.log_transition(self.fill(x, inputs.values), previous, inputs.inputs)

    def sample_observation(self, rng_key: jax.Array, x: jax.Array, inputs: Inputs = None) -> dict[str, jax.Array]:
        """Draw the data sites of a frame by name."""
        return self.full.sample_observation(rng_key, self.fill(x, _required(inputs).values), inputs.inputs)

    def draw_data(self, rng_key: jax.Array, x: jax.Array, inputs: Inputs = None) -> DrawnData:
        """Draw a frame's data, with their moments."""
        return self.full.draw_data(rng_key, self.fill(x, _required(inputs).values), inputs.inputs)

    def prediction_obstacle(self, inputs: Inputs = None) -> str | None:
        """Why no data can be drawn, or None."""
        return self.full.prediction_obstacle(_required(inputs).inputs)

    def log_observation(self, x: jax.Array, observation: Observation, inputs: Inputs = None) -> jax.Array:
        """Log-likelihood of a frame's data."""
        return self.full.log_observation(self.fill(x, _required(inputs).values), observation, inputs.inputs)

    def extras(self, x: jax.Array, inputs: Inputs = None) -> dict[str, jax.Array]:
        """The deterministic sites of the observation program."""
        return self.full.extras(self.fill(x, _required(inputs).values), inputs.inputs)

    def initial_moments(self, inputs: Inputs = None) -> tuple[jax.Array, jax.Array]:
        """Mean and covariance of the free coordinates of the first state."""
        mean, covariance = self.full.initial_moments(_required(inputs).inputs)
        return self._keep(mean), self._keep(self._keep(covariance), axis=1)

    def transition_moments(self, x_previous: jax.Array, inputs: Inputs = None) -> tuple[jax.Array, jax.Array]:
        """Mean and covariance of the free coordinates: the full ones' entries and block."""
        previous = self.fill(x_previous, _required(inputs).previous)
        mean, covariance = self.full.transition_moments(previous, inputs.inputs)
        return self._keep(mean), self._keep(self._keep(covariance), axis=1)

    def observation_moments(self, x: jax.Array, inputs: Inputs = None) -> tuple[jax.Array, jax.Array]:
        """Mean and covariance of a frame's data."""
        return self.full.observation_moments(self.fill(x, _required(inputs).values), inputs.inputs)

    def observation_slope(self, x: jax.Array, inputs: Inputs = None) -> jax.Array:
        """Derivative of the mean of a frame's data by the free coordinates."""
        return self._keep(self.full.observation_slope(self.fill(x, _required(inputs).values), inputs.inputs), axis=1)

    def observation_information(self, x: jax.Array, observation: Observation, inputs: Inputs = None) -> jax.Array:
        """The block of the full curvature that belongs to the free coordinates."""
        state = self.fill(x, _required(inputs).values)
        information = self.full.observation_information(state, observation, inputs.inputs)
        return self._keep(self._keep(information), axis=1)


def clamp(model: CompiledModel, free: Sequence[int | str]) -> ClampedModel:
    """The model of the coordinates `free` of `model`, with the others given by `Clamped` inputs.

    Args:
        model: The full model.
        free: Indices or names of the coordinates that stay free, in the order that the new flat state has them.

    Raises:
        ValueError: No coordinate, an unknown or repeated one, or a model that is clamped already.
    """
    if isinstance(model, ClampedModel):
        raise ValueError("The model is clamped already: clamp the full model (model.full) with all that should be given.")
    names = model.coordinate_names
    indices = []
    for index in free:
        if isinstance(index, str) and index not in names:
            raise ValueError(f"free names {index!r}, which is no coordinate. Expected some of {list(names)}.")
        indices.append(names.index(index) if isinstance(index, str) else int(index))
    if not indices or len(set(indices)) != len(indices) or not all(0 <= i < model.dimension for i in indices):
        raise ValueError(f"free is {list(free)}. Expected distinct coordinates, at least one, in 0..{model.dimension - 1}.")
    return _clamped(model, tuple(indices))


def _clamped(full: CompiledModel, free: tuple[int, ...]) -> ClampedModel:
    shared = (full.programs, full.sites, full.observation_sites, full.num_keys, full.params, full.unbound)
    return ClampedModel(*shared, full=full, free=free)


def _runs(entries: list[tuple[bool, int]]) -> list[_Run]:
    """Group (source, index) entries into runs of consecutive indices of one source."""
    runs: list[_Run] = []
    for source, index in entries:
        if runs and runs[-1].free == source and runs[-1].start + runs[-1].size == index:
            runs[-1] = runs[-1]._replace(size=runs[-1].size + 1)
        else:
            runs.append(_Run(source, index, 1))
    return runs


def _required(inputs: Any) -> Clamped:
    if not isinstance(inputs, Clamped):
        found = type(inputs).__name__
        raise ValueError(f"A clamped model got inputs of type {found}. Expected Clamped(inputs, values, previous).")
    return inputs
