"""A filter fed frame by frame, as the data come in.

    online = Online(filter, rng_key)
    state, info = online.update({"height": 0.9}, inputs)

The keys of a frame are those of :func:`poseppl.runs.run.run_filter`, and so are its results; the same is checked.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import jax
from jax import Array
from numpy.typing import ArrayLike

from poseppl.compilation import jit
from poseppl.filters.base import Filter, FilterInfo
from poseppl.filters.scan import frame_keys
from poseppl.program import Observation
from poseppl.program.earlier_data import WithEarlier
from poseppl.program.earlier_inputs import at_frame, following
from poseppl.program.explanation import check_inputs
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.observation import check_frame_shapes, check_is_observation
from poseppl.runs.course import RunError, breakdown_message
from poseppl.runs.frame_sequence import device_array
from poseppl.runs.recompilation import tell_filter_defined_anew
from poseppl.runs.step_output import is_finite


class Online:
    """A filter fed frame by frame, compiled once. It gives what :func:`run_filter` gives with the same key.

    Args:
        filter: The filter.
        rng_key: PRNG key.

    Attributes:
        frame: How many frames it has seen.
        state: The state after the last of them; None before the first.
    """

    def __init__(self, filter: Filter, rng_key: Array) -> None:
        self._filter, self._rng_key = filter, rng_key
        self._init, self._step = _programs(filter)
        self.frame = 0
        self.state: Any = None
        self._before: WithEarlier | None = None

    def update(self, observation: Observation | Mapping[str, ArrayLike], inputs: Any = None) -> tuple[Any, FilterInfo]:
        """Take the next frame.

        Args:
            observation: Data of the frame: an Observation, or values by the name of their site with NaN where nothing was seen.
            inputs: Inputs of the frame.

        Returns:
            The new state and the diagnosis; ``info.failed`` marks a failed frame.

        Raises:
            ValueError: The data are not one frame of the model's, or the inputs are not those that it was compiled for.
            RunError: The new state is not finite, computed twice; the tracker stays at the frame before.
        """
        observation, inputs = self._checked(observation, inputs)
        key = frame_keys(self._rng_key, self.frame).step
        state = self.state
        if state is None and self._filter.initial_state is not None:
            state = self._filter.initial_state(observation, inputs)
        for _ in range(2):  # a fault of the machine does not come again
            call = partial(self._init, key) if state is None else partial(self._step, key, state)
            new, info, finite = call(observation, inputs)
            if finite:
                self.state, self.frame = new, self.frame + 1
                self._before = following(self._filter.model, inputs, observation)
                return new, info
        raise RunError(breakdown_message(self.frame, new, self._filter.model), self.frame)

    def _checked(self, observation: Any, inputs: Any) -> tuple[Observation, Any]:
        """Data and inputs of a frame, in the form that the filter was compiled for."""
        model = self._filter.model
        if model is not None and isinstance(observation, Mapping):
            observation = model.observe(observation)
        check_is_observation(observation)
        inputs = jax.tree.map(device_array, at_frame(model, inputs, self._before))
        if model is None:
            return observation, inputs
        check_frame_shapes(model.observation_sites, observation)
        check_inputs(model.input_shapes, inputs)
        declared = model.input_shapes if jax.tree.leaves(model.input_shapes) else inputs
        return observation, jax.tree.map(lambda leaf, shape: device_array(leaf, shape.dtype), inputs, declared)


@memoized_builder
def _programs(filter: Filter) -> tuple[Any, Any]:
    """A filter's `init` and `step`, compiled for single frames; both return besides whether the state is finite."""
    tell_filter_defined_anew(filter)

    def init(rng_key: Array, observation: Observation, inputs: Any) -> tuple[Any, FilterInfo, Array]:
        state, info = filter.init(rng_key, observation, inputs)
        return state, info, is_finite(state, filter.model)

    def step(rng_key: Array, state: Any, observation: Observation, inputs: Any) -> tuple[Any, FilterInfo, Array]:
        new, info = filter.step(rng_key, state, observation, inputs)
        return new, info, is_finite(new, filter.model)

    return jit(init), jit(step)
