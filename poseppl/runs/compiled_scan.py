"""The compiled calls of the driver: the filter's `init`, and scans of frames, from host arrays to host arrays.

What is kept of a frame, and its predictive checks, are in the scan alone: it takes the first frame as `init` left it. Keys of
frames are made beforehand, by a program that all filters share. Both
programs are compiled before either runs, so that no compilation counts as time of the frames. The filter keeps what was
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
from jax import Array

from poseppl.compilation import compile_lowered, compile_to_run_once, double_precision, jit
from poseppl.filters.base import Filter, FilterState, Info
from poseppl.particles.stacks import rows_of
from poseppl.program import CompiledModel, Observation
from poseppl.program.built_once import built_once
from poseppl.program.large_integers import are_exact
from poseppl.runs.filter_history import bytes_of_frame, history_of_frame, with_genealogy_alone
from poseppl.runs.frame_sequence import FrameSequence, Layout
from poseppl.runs.predictive import Predict, Prediction
from poseppl.runs.recompilation import tell_defined_anew, tell_filter_defined_anew

Collect = Callable[[Array, Any, Any, Any], Any]
"""`(rng_key, state, info, inputs) -> pytree of arrays`: what is kept of a frame; `info` is a filter's, or None."""

_LONG, _SHORT, _SINGLE = 64, 8, 1
"""Frames of a compiled scan, whatever the parts of a run, so that all share one program: of most runs, of those of large
frames, and of those whose frames come one at a time. Rows without a frame copy the state."""
_LARGE = 2**20
"""Bytes of a frame's data, and of what is kept of it, beyond which it is large."""
_CHECKS = 2
"""Number that the key of the predictive checks is folded with, beside the two of :func:`frame_keys`."""
_KEY_PROGRAMS: dict[Any, Any] = {}
"""What makes the keys of frames, by the kind of the run's key."""


class Kept(NamedTuple):
    """Draws and diagnosis kept of a frame; of a sequence, with a leading T.

    Attributes:
        outputs: What `collect` returned.
        info: The filter's diagnosis; its ``ancestors`` are left out (shape (T, 0)), for they are as many as the particles.
        unique_ancestors: How many particles of the frame before have offspring.
        finite: Whether all particles of positive weight were finite, and their integers exact.
        prediction: The frame's data against their :class:`~poseppl.runs.predictive.Prediction`; None if that is not asked for.
        history: What smoothers need of it, see :mod:`poseppl.runs.filter_history`; None if it is not kept.
    """

    outputs: Any
    info: Info
    unique_ancestors: Any
    finite: Any
    prediction: Prediction | None
    history: Any


def frame_keys(rng_key: Array, frame: Any) -> tuple[Array, Array]:
    """Keys of the filter and of the collector at a frame."""
    key_filter, key_collect = jax.random.split(jax.random.fold_in(rng_key, frame))
    return key_filter, key_collect


def _key_data(rng_key: Array, start: int, checks: bool) -> tuple[Any, ...]:
    """Data of the keys of filter, collector and, if there are any, predictive checks at _LONG frames."""

    def of_frame(rng_key: Array, frame: Array) -> tuple[Array, ...]:
        key_checks = (jax.random.fold_in(jax.random.fold_in(rng_key, frame), _CHECKS),) if checks else ()
        return tuple(map(jax.random.key_data, (*frame_keys(rng_key, frame), *key_checks)))

    kind, frames = (kind_of(rng_key), checks), np.arange(start, start + _LONG, dtype=np.int32)
    if kind not in _KEY_PROGRAMS:
        lowered = jit(jax.vmap(of_frame, (None, 0))).lower(rng_key, frames)
        _KEY_PROGRAMS[kind] = compile_to_run_once(lowered, num_particles=1, num_numbers=1)
    made: tuple[Any, ...] = jax.tree.map(np.asarray, _KEY_PROGRAMS[kind](rng_key, frames))
    return made


def _key_like(rng_key: Array, data: Array) -> Array:
    """The key of some data, typed if another one is."""
    typed = jnp.issubdtype(rng_key.dtype, jax.dtypes.prng_key)
    return jax.random.wrap_key_data(data, impl=jax.random.key_impl(rng_key)) if typed else data


def _keep(
    outputs: Any, state: FilterState, info: Info, model: CompiledModel | None, prediction: Prediction | None, history: Any
) -> Kept:
    told = info._replace(ancestors=jnp.zeros(0, jnp.int32))
    return Kept(outputs, told, _num_unique(info.ancestors), is_finite(state, model), prediction, history)


def _num_unique(ancestors: Any) -> Any:
    """How many particles have offspring; known when the program is traced where a filter names none."""
    if isinstance(ancestors, np.ndarray):
        return np.int32(len(np.unique(ancestors)))
    return jnp.sum(jnp.zeros(ancestors.shape, jnp.int32).at[ancestors].set(1, mode="drop"))


def is_finite(state: FilterState, model: CompiledModel | None = None) -> Array:
    """Whether all particles of positive weight are finite, and, if the model is given, its integers exact."""
    alive = state.log_weights > -jnp.inf
    right = jnp.isfinite(state.particles).all(-1)
    if model is not None:
        right = right & are_exact(model.sites, state.particles)
    return jnp.all((right | ~alive) & ~jnp.isnan(state.log_weights))


class _Starts(NamedTuple):
    """The jitted functions that a run begins with: the filter's state before the first frame, or its `init`."""

    before: Any
    init: Any


class _Programs(NamedTuple):
    """The jitted functions of its frames: one of them, and a scan."""

    frame: Any
    scan: Any
    made: dict[Any, dict[str, Any]]
    """For each kind of data what :class:`Calls` made of the programs, by name."""


@built_once
def _starts(filter: Filter, layout: Layout) -> _Starts:
    """How a run begins, whatever is kept of it."""

    def before(observation: Observation, varying: list[Any], constant: list[Any]) -> Any:
        build: Any = filter.initial_state
        return build(observation, layout.join(varying, constant))

    def init(
        rng_key: Array, keys: tuple[Array, ...], observation: Observation, varying: list[Any], constant: list[Any]
    ) -> tuple[Any, Info]:
        return filter.init(_key_like(rng_key, keys[0]), observation, layout.join(varying, constant))

    return _Starts(jit(before), jit(init))


@built_once
def _programs(filter: Filter, collect: Collect, predict: Predict | None, layout: Layout, keep: bool) -> _Programs:
    """The programs, with or without the filter's history; kept, with what is compiled for them, by the filter."""
    tell_filter_defined_anew(filter)
    tell_defined_anew(filter, "collector", collect)
    tell_defined_anew(filter, "predictive check", predict)

    @jit  # so that it is traced once, whether for shapes or to be compiled
    def one_frame(
        rng_key: Array,
        keys: tuple[Array, ...],
        frame: Any,
        before: Any,
        begun: Info | None,
        observation: Observation,
        varying: list[Any],
        constant: list[Any],
    ) -> tuple[Any, Kept]:
        key_filter, key_collect, *key_checks = (_key_like(rng_key, data) for data in keys)
        inputs, first = layout.join(varying, constant), frame == 0
        prediction = predict(key_checks[0], before, first, observation, inputs) if predict else None

        def step(state: Any) -> tuple[Any, Info]:
            return filter.step(key_filter, state, observation, inputs)

        state, info = step(before) if begun is None else jax.lax.cond(first, lambda state: (state, begun), step, before)
        history = history_of_frame(filter, state, info) if keep else None
        outputs = collect(key_collect, state, with_genealogy_alone(filter, info), inputs)
        return state, _keep(outputs, state, info, filter.model, prediction, history)

    def scan_frames(
        state: Any,
        begun: Info | None,
        rng_key: Array,
        keys: tuple[Array, ...],
        frames: Array,
        active: Array,
        observations: Observation,
        varying: list[Any],
        constant: list[Any],
    ) -> tuple[Any, Kept]:
        """Frames of the numbers `frames` (length,) with their `keys`, of which the `active` (length,) ones count.

        Where the first is among them, `state` and `begun` are those of `init`; None where `step` takes the first one, too.
        """

        def body(state: Any, row: Any) -> tuple[Any, Kept]:
            keys, frame, wanted, observation, varying = row

            def run(state: Any) -> tuple[Any, Kept]:
                result: tuple[Any, Kept] = one_frame(rng_key, keys, frame, state, begun, observation, varying, constant)
                return result

            def skip(state: Any) -> tuple[Any, Kept]:
                return state, jax.tree.map(lambda kept: jnp.zeros(kept.shape, kept.dtype), jax.eval_shape(run, state)[1])

            result: tuple[Any, Kept] = jax.lax.cond(wanted, run, skip, state)
            return result

        return jax.lax.scan(body, state, (keys, frames, active, observations, varying))

    return _Programs(one_frame, jit(scan_frames), {})


class Calls:
    """The compiled programs of a run, and their data.

    Args:
        filter: The filter.
        collect: What is kept of a frame.
        predict: Predictive checks of a frame, or None.
        sequence: The data.
        rng_key: Key of the run.
        single: Whether frames come one at a time.
        history_bytes: Room for the filter's history; without room for all of it none is kept.

    Attributes:
        filter: The filter.
        history_bytes: What the whole history takes.
        keeps_history: Whether it is kept.
        state: A state of the right shapes; nothing is compiled for it.
        blank: What is kept of a frame, of the right shapes.
    """

    def __init__(
        self,
        filter: Filter,
        collect: Collect,
        predict: Predict | None,
        sequence: FrameSequence,
        rng_key: Array,
        single: bool = False,
        history_bytes: float = 0,
    ) -> None:
        self.filter, self._sequence, self._rng_key = filter, sequence, rng_key
        self._keys: tuple[Any, ...] = ()
        self._keys_from, self._checks = -_LONG, predict is not None
        self._starting: _Starts = _starts(filter, sequence.layout)
        blank, begun = self._blank_state()
        self.history_bytes = bytes_of_frame(filter, blank) * sequence.num_frames
        self.keeps_history = 0 < self.history_bytes <= history_bytes
        self._programs: _Programs = _programs(filter, collect, predict, sequence.layout, self.keeps_history)
        self._made = self._programs.made.setdefault(kind_of(self._first_data()), {})
        self.state, self._begun, self.blank = self._once("blank", lambda: self._blank(blank, begun))
        size = sum(leaf.nbytes for leaf in jax.tree.leaves((sequence.frame(0), self.blank)))
        self._length = _SINGLE if single else _SHORT if size > _LARGE else _LONG
        self._begin: Any = None
        self._scan: Any = None

    def compile(self, first: bool) -> None:
        """Compile both programs side by side; that of the start only if the first frame is wanted."""
        double = jnp.result_type(float) == jnp.float64  # which another thread does not know

        def start() -> Any:
            with double_precision(double):
                return self._once("start", self._compiled_start)

        with ThreadPoolExecutor(1) as pool:
            compiling = pool.submit(start) if first else None
            self._scan = self._once(f"scan of {self._length}", self._compiled_scan)
            self._begin = compiling.result() if compiling else None

    def feed(self, sequence: FrameSequence) -> None:
        """Go on with later frames, of the same shapes and constant inputs."""
        self._sequence = sequence

    def inputs_are_finite(self, frame: int) -> bool:
        """Whether no input of a frame is NaN or infinite."""
        return self._sequence.inputs_are_finite(frame)

    def advance(self, state: Any, start: int, stop: int) -> tuple[Any, Kept]:
        """From the state after the frame before `start`, the state after that before `stop`, and what is kept in between."""
        begun, kept = self._begun, []
        if start == 0:
            state, begun = self._start()
        for begin in range(start, stop, self._length):
            end = min(begin + self._length, stop)
            state, frames = _on_host(self._scan(*self._scan_data(state, begun, begin, end)), end - begin)
            kept.append(frames)
        return state, joined(kept)

    def _start(self) -> tuple[Any, Info | None]:
        """State and diagnosis that the scan begins with."""
        if self.filter.initial_state is None:
            state, begun = self._begin(*self._first_data())
            return state, jax.tree.map(np.asarray, begun)  # of no device, so that the scan may place it
        return self._begin(*self._first_data()[2:]), None

    def _once(self, name: str, make: Callable[[], Any]) -> Any:
        """What an earlier run on data of the same kind made, or what is made now."""
        if name not in self._made:
            self._made[name] = make()
        return self._made[name]

    def _compiled_start(self) -> Any:
        if self.filter.initial_state is None:
            lowered = self._starting.init.lower(*self._first_data())
        else:
            lowered = self._starting.before.lower(*self._first_data()[2:])
        return compile_to_run_once(lowered, self.state.log_weights.size, self.state.particles.size)

    def _compiled_scan(self) -> Any:
        lowered = self._programs.scan.lower(*self._scan_data(self.state, self._begun, 0, 1))
        return compile_lowered(lowered, self.state.log_weights.size, self.state.particles.size)

    def _blank_state(self) -> tuple[Any, Info | None]:
        """Shapes of the state, and of its diagnosis by `init`."""
        if self.filter.initial_state is None:
            shapes: tuple[Any, Info] = self._starting.init.eval_shape(*self._first_data())
            return shapes
        return self._starting.before.eval_shape(*self._first_data()[2:]), None

    def _blank(self, state: Any, begun: Info | None) -> tuple[Any, Info | None, Kept]:
        """Zeros in the shapes of the state, of its diagnosis by `init`, and of what is kept of a frame."""
        frame = *self._sequence.frame(0), self._sequence.constant
        state, kept = self._programs.frame.eval_shape(*self._first_data()[:2], np.int32(0), state, begun, *frame)
        blank: tuple[Any, Info | None, Kept] = jax.tree.map(lambda x: np.zeros(x.shape, x.dtype), (state, begun, kept))
        return blank

    def _first_data(self) -> tuple[Any, ...]:
        return self._rng_key, rows_of(self._frame_keys(0, 1), 0), *self._sequence.frame(0), self._sequence.constant

    def _frame_keys(self, start: int, length: int) -> tuple[Any, ...]:
        """Data of the keys of frames, which are made for more at once."""
        if not self._keys_from <= start <= self._keys_from + _LONG - length:
            self._keys, self._keys_from = _key_data(self._rng_key, start, self._checks), start
        begin = start - self._keys_from
        return rows_of(self._keys, slice(begin, begin + length))

    def _scan_data(self, state: Any, begun: Info | None, start: int, stop: int) -> tuple[Any, ...]:
        numbers = np.arange(start, start + self._length, dtype=np.int32)
        rows, varying = self._sequence.rows(start, self._length)
        placed, constant = self.filter.to_devices(state), self._sequence.constant
        keys = self._frame_keys(start, self._length)
        return placed, begun, self._rng_key, keys, numbers, numbers < stop, rows, varying, constant


def joined(parts: list[Kept]) -> Kept:
    """What was kept of frames that follow each other."""
    whole: Kept = jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)
    return whole


def kind_of(data: Any) -> Any:
    """What programs are compiled for: structure, shapes, types and places of the data, and type and place of new numbers."""
    leaves, structure = jax.tree.flatten(data)
    new = jax.device_put(np.zeros(()))
    return structure, tuple((jax.typeof(leaf), getattr(leaf, "sharding", None)) for leaf in (*leaves, new))


def _on_host(result: tuple[Any, Kept], num_frames: int) -> tuple[Any, Kept]:
    """The frames of a call on the host; the state stays where it is."""
    state, kept = result
    return state, jax.tree.map(lambda leaf: np.asarray(leaf)[:num_frames], kept)
