"""The compiled calls of the driver: the first frame, and scans of later ones, from host arrays to host arrays.

Both programs are compiled before either runs, so that no compilation counts as time of the frames. The filter keeps what was
compiled for it: a run whose filter, collector and shapes are those of an earlier one compiles nothing, and what was compiled
goes with the filter.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from poseppl.filters.base import Filter, FilterState, Info
from poseppl.program import Observation
from poseppl.program.built_once import built_once
from poseppl.runs.frame_sequence import FrameSequence, Layout
from poseppl.runs.predictive import Predict, Prediction
from poseppl.runs.recompilation import tell_defined_anew, tell_filter_defined_anew

Collect = Callable[[jax.Array, Any, Any, Any], Any]
"""`(rng_key, state, info, inputs) -> pytree of arrays`: what is kept of a frame; `info` is a filter's, or None."""

_LONG, _SHORT = 64, 8
"""Frames of a compiled scan, whatever the parts of a run, so that all share one program; the fewer where a frame is large."""
_LARGE = 2**20
"""Bytes of a frame's data, and of what is kept of it, beyond which it is large."""
_CHECKS = 2
"""Number that the key of the predictive checks is folded with, beside the two of :func:`frame_keys`."""


class Kept(NamedTuple):
    """Draws and diagnosis kept of a frame; of a sequence, with a leading T.

    Attributes:
        outputs: What `collect` returned.
        info: The filter's diagnosis; its ``ancestors`` are left out (shape (T, 0)), for they are as many as the particles.
        unique_ancestors: How many particles of the frame before have offspring.
        finite: Whether all particles of positive weight were finite.
        prediction: The frame's data against their :class:`~poseppl.runs.predictive.Prediction`; None if that is not asked for.
    """

    outputs: Any
    info: Info
    unique_ancestors: Any
    finite: Any
    prediction: Prediction | None


def frame_keys(rng_key: jax.Array, frame: Any) -> tuple[jax.Array, jax.Array]:
    """Keys of the filter and of the collector at a frame."""
    key_filter, key_collect = jax.random.split(jax.random.fold_in(rng_key, frame))
    return key_filter, key_collect


def _prediction_key(rng_key: jax.Array, frame: Any) -> jax.Array:
    """Key of the predictive checks at a frame; those of filter and collector do not depend on whether it is used."""
    return jax.random.fold_in(jax.random.fold_in(rng_key, frame), _CHECKS)


def _keep(
    collect: Collect, rng_key: jax.Array, state: FilterState, info: Info, inputs: Any, prediction: Prediction | None
) -> Kept:
    offspring = jnp.zeros(info.ancestors.shape, jnp.int32).at[info.ancestors].set(1, mode="drop")
    outputs = collect(rng_key, state, info, inputs)
    told = info._replace(ancestors=jnp.zeros(0, jnp.int32))
    return Kept(outputs, told, jnp.sum(offspring), is_finite(state), prediction)


def is_finite(state: FilterState) -> jax.Array:
    """Whether all particles of positive weight are finite."""
    alive = state.log_weights > -jnp.inf
    return jnp.all(jnp.isfinite(state.particles) | ~alive[..., None]) & ~jnp.any(jnp.isnan(state.log_weights))


class Programs(NamedTuple):
    """The jitted functions of a run: the first frame, another one, and a scan of later frames."""

    first: Any
    other: Any
    scan: Any


@built_once
def _programs(filter: Filter, collect: Collect, predict: Predict | None, layout: Layout) -> Programs:
    """The programs; kept, with what is compiled for them, by the filter."""
    tell_filter_defined_anew(filter)
    tell_defined_anew(filter, "collector", collect)
    tell_defined_anew(filter, "predictive check", predict)

    def first_frame(rng_key: jax.Array, observation: Observation, varying: list[Any], constant: list[Any]) -> tuple[Any, Kept]:
        key_filter, key_collect = frame_keys(rng_key, 0)
        inputs = layout.join(varying, constant)
        key_check = _prediction_key(rng_key, 0)
        prediction = predict(key_check, None, True, observation, inputs) if predict else None
        state, info = filter.init(key_filter, observation, inputs)
        kept = _keep(collect, key_collect, state, info, inputs, prediction)
        return state, jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], kept)

    @jax.jit  # so that it is traced once, whether for shapes or to be compiled
    def one_frame(
        rng_key: jax.Array, frame: Any, state: Any, observation: Observation, varying: list[Any], constant: list[Any]
    ) -> tuple[Any, Kept]:
        key_filter, key_collect = frame_keys(rng_key, frame)
        inputs = layout.join(varying, constant)
        first = False if filter.initial_state is None else frame == 0
        key_check = _prediction_key(rng_key, frame)
        prediction = predict(key_check, state, first, observation, inputs) if predict else None
        new, info = filter.step(key_filter, state, observation, inputs)
        return new, _keep(collect, key_collect, new, info, inputs, prediction)

    def scan_frames(
        state: Any,
        blank: Kept,
        rng_key: jax.Array,
        frames: jax.Array,
        active: jax.Array,
        observations: Observation,
        varying: list[Any],
        constant: list[Any],
    ) -> tuple[Any, Kept]:
        """Later frames of the numbers `frames` (length,), of which the `active` (length,) ones count."""

        def body(state: Any, row: Any) -> tuple[Any, Kept]:
            frame, wanted, observation, varying = row

            def run(state: Any) -> tuple[Any, Kept]:
                result: tuple[Any, Kept] = one_frame(rng_key, frame, state, observation, varying, constant)
                return result

            result: tuple[Any, Kept] = jax.lax.cond(wanted, run, lambda old: (old, blank), state)
            return result

        return jax.lax.scan(body, state, (frames, active, observations, varying))

    return Programs(jax.jit(first_frame), one_frame, jax.jit(scan_frames))


class Calls:
    """The two compiled programs of a run, and their data.

    Args:
        filter: The filter.
        collect: What is kept of a frame.
        predict: Predictive checks of a frame, or None.
        sequence: The data.
        rng_key: Key of the run.

    Attributes:
        filter: The filter.
        state: A state of the right shapes; nothing is compiled for it.
        blank: What is kept of a frame, of the right shapes.
    """

    def __init__(
        self,
        filter: Filter,
        collect: Collect,
        predict: Predict | None,
        sequence: FrameSequence,
        rng_key: jax.Array,
    ) -> None:
        self.filter, self._sequence, self._rng_key = filter, sequence, rng_key
        self._programs: Programs = _programs(filter, collect, predict, sequence.layout)
        self.state, self.blank = jax.tree.map(lambda leaf: np.zeros(leaf.shape, leaf.dtype), self._shapes())
        size = sum(leaf.nbytes for leaf in jax.tree.leaves((sequence.frame(0), self.blank)))
        self._length = _SHORT if size > _LARGE else _LONG
        self._before: Any = None
        self._first: Any = None
        self._scan: Any = None

    def compile(self, first: bool) -> None:
        """Compile both programs side by side; that of the first frame only if it is wanted."""
        filter, sequence = self.filter, self._sequence
        with ThreadPoolExecutor(1) as pool:
            alone = first and filter.initial_state is None
            compiling = pool.submit(_compiled, self._programs.first, self._first_data()) if alone else None
            if first and filter.initial_state is not None:
                self._before = _before(filter, sequence)
            if sequence.num_frames > 1 or filter.initial_state is not None:
                self._scan = _compiled(self._programs.scan, self._scan_data(self.state, 1, 1))
            self._first = compiling.result() if compiling else None

    def advance(self, state: Any, start: int, stop: int) -> tuple[Any, Kept]:
        """From the state after the frame before `start`, the state after that before `stop`, and what is kept in between.

        The first frame is advanced alone.
        """
        if start == 0 and self._first is not None:
            return _on_host(self._first(*self._first_data()), 1)
        state = self._before if start == 0 else state
        kept = []
        for begin in range(start, stop, self._length):
            end = min(begin + self._length, stop)
            state, frames = _on_host(self._scan(*self._scan_data(state, begin, end)), end - begin)
            kept.append(frames)
        return state, joined(kept)

    def _shapes(self) -> tuple[Any, Kept]:
        """Leaves with the shapes of those of the state, and of what is kept of a frame."""
        if self.filter.initial_state is None:
            state, kept = self._programs.first.eval_shape(*self._first_data())
            return state, jax.tree.map(lambda leaf: np.zeros(leaf.shape[1:], leaf.dtype), kept)
        observation, varying, constant = *self._sequence.frame(0), self._sequence.constant
        before = jax.eval_shape(lambda: _before(self.filter, self._sequence))
        shapes: tuple[Any, Kept] = self._programs.other.eval_shape(
            self._rng_key, np.int32(0), before, observation, varying, constant
        )
        return shapes

    def _first_data(self) -> tuple[Any, ...]:
        return self._rng_key, *self._sequence.frame(0), self._sequence.constant

    def _scan_data(self, state: Any, start: int, stop: int) -> tuple[Any, ...]:
        numbers = np.arange(start, start + self._length, dtype=np.int32)
        rows, varying = self._sequence.rows(start, self._length)
        placed = self.filter.to_devices(state)
        return placed, self.blank, self._rng_key, numbers, numbers < stop, rows, varying, self._sequence.constant


def joined(parts: list[Kept]) -> Kept:
    """What was kept of frames that follow each other."""
    whole: Kept = jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)
    return whole


def _compiled(program: Any, data: tuple[Any, ...]) -> Any:
    return program.lower(*data).compile()


def _before(filter: Filter, sequence: FrameSequence) -> Any:
    """The state before the first frame."""
    observation, varying = sequence.frame(0)
    build: Any = filter.initial_state
    return build(observation, sequence.layout.join(varying, sequence.constant))


def _on_host(result: tuple[Any, Kept], num_frames: int) -> tuple[Any, Kept]:
    """The frames of a call on the host; the state stays where it is."""
    state, kept = result
    return state, jax.tree.map(lambda leaf: np.asarray(leaf)[:num_frames], kept)
