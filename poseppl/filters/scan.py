"""A filter run through a sequence as one pure function, and the rule by which every run derives its keys.

>>> import numpyro, numpyro.distributions as dist, poseppl
>>> def initial(params, inputs):
...     numpyro.sample("level", dist.Normal(0.0, 1.0))
>>> def transition(params, state, inputs):
...     numpyro.sample("level", dist.Normal(state["level"], 0.5))
>>> def observation(params, state, inputs):
...     numpyro.sample("height", dist.Normal(state["level"], 1.0))
>>> model = poseppl.StateSpaceModel(initial, transition, observation).compile()
>>> filter, data = poseppl.particle_filter(model, 100), model.observe({"height": [0.3, float("nan"), 0.8]})
>>> scan = jax.jit(lambda key: poseppl.scan_filter(filter, key, data))(jax.random.key(0))
>>> scan.outputs.log_evidence.shape, scan.state.particles.shape
((3,), (100, 1))

The filter draws at frame t from ``frame_keys(rng_key, t).step``, whichever function runs it: :func:`scan_filter`,
:func:`poseppl.run_filter`, :func:`poseppl.infer`, :class:`poseppl.Online` or :func:`poseppl.log_likelihood`. So runs of one key
are one run, however its frames are split. Series i of :func:`poseppl.infer_batch` has the key ``fold_in(rng_key, i)``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_key
from poseppl.filters.base import Filter, FilterInfo
from poseppl.particles.stacks import tree_index
from poseppl.program import Observation
from poseppl.program.earlier_inputs import with_earlier_data
from poseppl.program.frame_inputs import check_input_rows, joined, split_inputs
from poseppl.program.observation import check_is_observation, num_frames_of

Collect = Callable[[Array, Any, Any, Any], Any]
"""`(rng_key, state, info, inputs) -> pytree of arrays`: what is kept of a frame; `info` is a filter's, or None."""
Predict = Callable[[Array, Any, Any, Observation, Any], Any]
"""`(rng_key, state, first, observation, inputs) -> pytree of arrays`: what is kept of a frame, from the state before it.

At the first frame, where `first` is true, `state` has the right shapes and no meaning.
"""
_PREDICT = 2
"""The number that a frame's key is folded with for its predictions, besides the two that it is split into."""
_MAX_RECOMPUTED = 1000
"""Entries of particles up to which reverse mode computes a frame again rather than keep what its derivative needs.

That is faster for formulas and few numbers: a Kalman filter's gradient takes a fifth of the time. For 1,000 particles, whose
draws would be made twice, it takes double the time.
"""


class FrameKeys(NamedTuple):
    """Keys of one frame: of the filter's `init` or `step`, of `collect`, and of `predict`."""

    step: Array
    collect: Array
    predict: Array


class Scan(NamedTuple):
    """The output of a run.

    Attributes:
        outputs: The outputs of `collect`, with a leading T.
        state: The filter's state after the last frame.
        prediction: The outputs of `predict`, with a leading T; None without it.
    """

    outputs: Any
    state: Any
    prediction: Any = None


class Start(NamedTuple):
    """The start of a run: the state after `init` and its diagnosis; or the state before the first frame, and None."""

    state: Any
    info: FilterInfo | None


class Frame(NamedTuple):
    """One frame, or with a leading T several: its keys, number and data, and those inputs that vary."""

    keys: FrameKeys
    number: Any
    observation: Observation
    varying: list[Any]


def frame_keys(rng_key: Array, frame: Any) -> FrameKeys:
    """Keys of a frame, from the run's key and the number of the frame, which counts from 0."""
    of_frame = jax.random.fold_in(rng_key, frame)
    step, collect = jax.random.split(of_frame)
    return FrameKeys(step, collect, jax.random.fold_in(of_frame, _PREDICT))


def collect_info(rng_key: Array, state: Any, info: FilterInfo, inputs: Any) -> FilterInfo:
    """Keep of each frame its diagnosis, without the ancestors, which are as many as the particles."""
    return info._replace(ancestors=jnp.zeros(0, jnp.int32))


def scan_filter(
    filter: Filter,
    rng_key: Array,
    observations: Observation | Mapping[str, Any],
    inputs: Any = None,
    *,
    collect: Collect = collect_info,
    predict: Predict | None = None,
) -> Scan:
    """Run a filter over T frames, inside `jax.jit`, `jax.vmap` and `jax.grad` or outside.

    Only what `collect` and `predict` return grows with T. A frame with impossible data is predicted and flagged in
    ``info.failed``; a state that is not finite is not noticed. :func:`poseppl.run_filter` runs the same frames with messages,
    progress and a checkpoint. For a gradient by static parameters, build the filter of ``model.with_params(params)``;
    :mod:`poseppl.runs.log_likelihood` says which filters have one.

    Args:
        filter: The filter.
        rng_key: PRNG key; the same key gives the run that :func:`poseppl.infer` gives.
        observations: Data with a leading T: an Observation, or outside of `jax.jit` arrays by site, NaN where nothing was seen.
        inputs: Inputs with a leading T, constant parts wrapped in :class:`poseppl.Constant`; None where the model takes none.
        collect: `(rng_key, state, info, inputs of the frame) -> pytree`, what is kept of a frame; the diagnosis by default.
        predict: `(rng_key, state before the frame, first, observation, inputs) -> pytree`, what is kept of a frame before its
            data are used, such as :func:`poseppl.predictive_checks`.

    Returns:
        The outputs, with a leading T, and the state after the last frame.

    Raises:
        ValueError: The data are no Observation, or an array does not have T rows.
    """
    check_key(rng_key)
    if filter.model is not None:
        observations = filter.model.observe(observations)
        inputs = with_earlier_data(filter.model, observations, inputs)
        num_frames = num_frames_of(filter.model.observation_sites, observations)
    else:
        check_is_observation(observations)
        num_frames = len(jax.tree.leaves(observations)[0])
    check_input_rows(inputs, num_frames)
    layout, *inputs = split_inputs(inputs)
    data, varying, constant = jax.tree.map(jnp.asarray, (observations, *inputs))
    numbers = jnp.arange(num_frames, dtype=jnp.int32)
    frames = Frame(jax.vmap(frame_keys, (None, 0))(rng_key, numbers), numbers, data, varying)
    if filter.in_parallel is not None:
        whole = filter.in_parallel(frames.keys.step, data, lambda: joined(layout, varying, constant, num_frames))
        if whole is not None:
            return _scan_of(whole, filter, frames, layout.join, constant, collect, predict)
    first = tree_index(frames, 0)
    start = begin(filter, first.keys.step, first.observation, layout.join(first.varying, constant))
    advance = frame_program(filter, layout.join, collect, predict)

    def of_frame(state: Any, frame: Frame) -> tuple[Any, Any]:
        return advance(state, start.info, frame, constant)

    if filter.closed_form or start.state.particles.size <= _MAX_RECOMPUTED:
        of_frame = jax.checkpoint(of_frame, prevent_cse=False)
    state, kept = jax.lax.scan(of_frame, start.state, frames)
    return Scan(kept[0], state, kept[1])


def _scan_of(
    whole: tuple[Any, FilterInfo],
    filter: Filter,
    frames: Frame,
    join: Callable[[Any, Any], Any],
    constant: list[Any],
    collect: Collect,
    predict: Predict | None,
) -> Scan:
    """The output of a run whose states and diagnoses of all frames are known."""
    states, infos = whole

    def of_frame(before: Any, state: Any, info: FilterInfo, frame: Frame) -> tuple[Any, Any]:
        inputs = join(frame.varying, constant)
        arguments = frame.keys.predict, before, frame.number == 0, frame.observation, inputs
        return collect(frame.keys.collect, state, info, inputs), predict(*arguments) if predict else None

    before = jax.tree.map(lambda leaf: jnp.roll(leaf, 1, 0), states)  # the first one means nothing
    outputs, prediction = jax.vmap(of_frame)(before, states, infos, frames)
    return Scan(outputs, tree_index(states, -1), prediction)


def begin(filter: Filter, rng_key: Array, observation: Observation, inputs: Any) -> Start:
    """The start of a run, from its first frame and the key of that frame's `init`."""
    if filter.initial_state is None:
        return Start(*filter.init(rng_key, observation, inputs))
    return Start(filter.initial_state(observation, inputs), None)


def frame_program(
    filter: Filter, join: Callable[[Any, Any], Any], collect: Collect, predict: Predict | None
) -> Callable[..., tuple[Any, tuple[Any, Any]]]:
    """`(state, initial_info, frame, constant) -> (state, (outputs, prediction))`, one frame of a run.

    `initial_info` is the diagnosis of `init`, whose state the first frame uses unchanged, or None if `step` takes the first
    frame, too. `join` makes a frame's inputs of the varying and the constant ones.
    """

    def advance(before: Any, initial_info: FilterInfo | None, frame: Frame, constant: list[Any]) -> tuple[Any, tuple[Any, Any]]:
        inputs, first = join(frame.varying, constant), frame.number == 0
        prediction = predict(frame.keys.predict, before, first, frame.observation, inputs) if predict else None

        def step(state: Any) -> tuple[Any, FilterInfo]:
            return filter.step(frame.keys.step, state, frame.observation, inputs)

        state, info = (
            step(before) if initial_info is None else jax.lax.cond(first, lambda state: (state, initial_info), step, before)
        )
        return state, (collect(frame.keys.collect, state, info, inputs), prediction)

    return advance
