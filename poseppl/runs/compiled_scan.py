"""The compiled calls of the driver: the filter's `init`, and scans of frames, from host arrays to host arrays.

Only the scan has the collector and the predictive checks; it takes the first frame as `init` left it. Another program, which
all filters share, makes the keys of frames beforehand. Both programs are compiled before either runs, so that no compilation
counts as time of the frames. The filter keeps its compiled programs: a run with the same filter, collector and shapes as an
earlier one compiles nothing. They are freed with the filter.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from threading import Lock
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from poseppl.compilation import compile_lowered, compile_to_run_once, double_precision, jit
from poseppl.filters.base import Filter, FilterInfo
from poseppl.filters.scan import (
    Collect,
    Frame,
    FrameKeys,
    Predict,
    Start,
    begin,
    frame_keys,
    frame_program,
)
from poseppl.gaussians.gaussian import Gaussian, RootGaussian
from poseppl.particles.stacks import tree_index
from poseppl.program.memoized_builder import memoized_builder
from poseppl.runs.filter_history import bytes_of_frame
from poseppl.runs.frame_sequence import FrameSequence, Layout
from poseppl.runs.gaussian_draws import key_data
from poseppl.runs.recompilation import tell_filter_defined_anew, warn_recompilation
from poseppl.runs.step_output import StepOutput, collect_kept, joined, with_draws
from poseppl.stored_programs import key_of, recalled

_LONGEST, _LONG, _SHORT = 512, 64, 8
"""Room for frames of a compiled call, whatever the parts of a run, so that all share one program, and its rounding: of small
frames, of most, and of large ones. A call takes as many frames as there are."""
_KEYS = 512
"""Frames whose keys are made at once."""
_SMALL, _LARGE = 2**10, 2**20
"""Bytes of a frame's data, and of what is kept of it, up to which it is small, and beyond which it is large."""
_TRACING = Lock()
"""NumPyro has one stack of handlers for all threads: programs are traced one after the other, and compiled side by side."""


_key_programs: dict[Any, Any] = {}
"""Compiled programs of :func:`_key_data`, by the kind of the run's key."""


def _keys_of_frames(rng_key: Array, start: int) -> FrameKeys:
    """Data of the keys of _KEYS frames, on the host."""
    given = rng_key, np.int32(start)
    kind = abstract_signature(given)
    if kind not in _key_programs:
        stored = key_of(given, _key_data)
        made = recalled(stored, f"keys of {_KEYS}", lambda: compile_to_run_once(jit(_key_data).lower(*given), 1, 1))
        _key_programs[kind] = made
    keys: FrameKeys = jax.tree.map(np.asarray, _key_programs[kind](*given))
    return keys


def _key_data(rng_key: Array, start: Any) -> FrameKeys:
    """Data of the keys of _KEYS frames."""
    keys: FrameKeys = jax.vmap(frame_keys, (None, 0))(rng_key, start + jnp.arange(_KEYS, dtype=jnp.int32))
    data: FrameKeys = jax.tree.map(jax.random.key_data, keys)
    return data


def _keys_like(rng_key: Array, data: FrameKeys) -> FrameKeys:
    """The keys of some data, typed if another one is."""
    if not jnp.issubdtype(rng_key.dtype, jax.dtypes.prng_key):
        return data
    keys: FrameKeys = jax.tree.map(lambda each: jax.random.wrap_key_data(each, impl=jax.random.key_impl(rng_key)), data)
    return keys


class _Programs(NamedTuple):
    """The jitted functions of a run's frames: one of them, and a scan."""

    frame: Any
    scan: Any
    made: dict[Any, dict[str, Any]]
    """For each kind of data what :class:`CompiledRun` made of the programs, by name."""


@memoized_builder
def _start_program(filter: Filter, layout: Layout) -> tuple[Any, dict[Any, Start]]:
    """`(rng_key, frame, constant) -> Start`, jitted; how a run begins, whatever is kept of it. Its shapes by kind of data."""

    def start(rng_key: Array, frame: Frame, constant: list[Any]) -> Start:
        key = _keys_like(rng_key, frame.keys).step
        return begin(filter, key, frame.observation, layout.join(frame.varying, constant))

    return jit(start), {}


@memoized_builder
def _programs(filter: Filter, collect: Collect, predict: Predict | None, layout: Layout, keep: bool) -> _Programs:
    """The programs, with or without the filter's history; kept, with what is compiled for them, by the filter."""
    tell_filter_defined_anew(filter)
    warn_recompilation(filter, "collector", collect)
    warn_recompilation(filter, "predictive check", predict)
    advance = frame_program(filter, layout.join, collect_kept(filter, collect, keep, lean=True), predict)

    @jit  # so that it is traced once, whether for shapes or to be compiled
    def one_frame(rng_key: Array, start: Start, frame: Frame, constant: list[Any]) -> tuple[Any, StepOutput]:
        frame = frame._replace(keys=_keys_like(rng_key, frame.keys))
        state, (kept, prediction) = advance(start.state, start.info, frame, constant)
        return state, kept._replace(prediction=prediction)

    def scan_frames(rng_key: Array, start: Start, frames: Frame, count: Array, constant: list[Any]) -> tuple[Any, StepOutput]:
        """Run the first `count` of the frames. If the sequence's first frame is among them, `start` is that of `init`."""

        def advance_one(row: Array, before: tuple[Any, StepOutput]) -> tuple[Any, StepOutput]:
            state, kept = before
            frame = jax.tree.map(lambda rows: jax.lax.dynamic_index_in_dim(rows, row, keepdims=False), frames)
            state, new = one_frame(rng_key, start._replace(state=state), frame, constant)
            return state, jax.tree.map(lambda rows, value: jax.lax.dynamic_update_index_in_dim(rows, value, row, 0), kept, new)

        shapes = jax.eval_shape(one_frame, rng_key, start, tree_index(frames, 0), constant)[1]
        blank = jax.tree.map(lambda leaf: jnp.zeros((len(frames.number), *leaf.shape), leaf.dtype), shapes)
        result: tuple[Any, StepOutput] = jax.lax.fori_loop(0, count, advance_one, (start.state, blank))
        return result

    return _Programs(one_frame, jit(scan_frames), {})


class CompiledRun:
    """The compiled programs of a run, and their data.

    Args:
        filter: The filter.
        collect: Collector of each frame.
        predict: Predictive checks of a frame, or None.
        sequence: The data.
        rng_key: Key of the run.
        history_bytes: Room for the filter's history; without room for all of it none is kept.

    Attributes:
        filter: The filter.
        history_bytes: Size of the whole history in bytes.
        keeps_history: Whether it is kept.
        state: A state of the right shapes; nothing is compiled for it.
        blank: Output of the collector for one frame, of the right shapes.
    """

    def __init__(
        self,
        filter: Filter,
        collect: Collect,
        predict: Predict | None,
        sequence: FrameSequence,
        rng_key: Array,
        history_bytes: float = 0,
    ) -> None:
        self.filter, self._sequence, self._rng_key = filter, sequence, rng_key
        self._collect = collect
        self._keys: Any = None
        self._keys_from = -_KEYS
        self._starting, shapes = _start_program(filter, sequence.layout)
        first = self._first_data()
        kind = abstract_signature(first)
        self._key = key_of(first, filter, collect, predict, sequence.layout)
        if kind not in shapes:
            shapes[kind] = recalled(self._key, "shapes", lambda: self._starting.eval_shape(*first))
        start = shapes[kind]
        self.history_bytes = bytes_of_frame(filter, start.state) * sequence.num_frames
        self.keeps_history = 0 < self.history_bytes <= history_bytes
        self._programs: _Programs = _programs(filter, collect, predict, sequence.layout, self.keeps_history)
        self._made = self._programs.made.setdefault(kind, {})
        self.state, self._begun, self.blank, collected = self._once("blank", lambda: self._blank(start))
        given = _bytes(sequence.frame(0))
        room = _SHORT if given + _bytes(self.blank) > _LARGE else _LONG
        self._length = min(_LONGEST, _KEYS) if given + collected <= _SMALL else room
        self._begin: Any = None
        self._scan: Any = None

    def compile(self, first: bool) -> None:
        """Compile both programs side by side; that of the start only if the first frame is wanted."""
        scan = f"scan of {self._length}"
        if scan in self._made and (not first or "start" in self._made):
            self._scan, self._begin = self._made[scan], self._made.get("start")
            return
        double = jnp.result_type(float) == jnp.float64  # which another thread does not know

        def start() -> Any:
            with double_precision(double):
                return self._once("start", self._compiled_start)

        with ThreadPoolExecutor(1) as pool:
            compiling = pool.submit(start) if first else None
            self._scan = self._once(scan, self._compiled_scan)
            self._begin = compiling.result() if compiling else None

    @property
    def seconds(self) -> float | None:
        """Seconds of a frame, as the latest run on data of this kind measured them; None before the first."""
        return self._made.get("seconds")

    @seconds.setter
    def seconds(self, measured: float) -> None:
        self._made["seconds"] = measured

    def feed(self, sequence: FrameSequence) -> None:
        """Go on with later frames, of the same shapes and constant inputs."""
        self._sequence = sequence

    def inputs_are_finite(self, frame: int) -> bool:
        """Whether no input of a frame is NaN or infinite."""
        return self._sequence.inputs_are_finite(frame)

    def advance(self, state: Any, start: int, stop: int) -> tuple[Any, StepOutput]:
        """From the state after the frame before `start`, the state after that before `stop`, and what is kept in between."""
        before, kept = Start(state, self._begun), []
        if start == 0:
            before = self._begin(*self._first_data())
            before = before._replace(info=jax.tree.map(np.asarray, before.info))  # of no device, so that the scan may place it
        for first in range(start, stop, self._length):
            end = min(first + self._length, stop)
            state, frames = _on_host(self._scan(*self._scan_data(before, first, end)), end - first)
            before = before._replace(state=state)
            kept.append(frames)
        whole = kept[0] if len(kept) == 1 else joined(kept)
        return state, with_draws(self._collect, whole, self._key_data, start)

    def _once(self, name: str, make: Callable[[], Any]) -> Any:
        """Get what an earlier run made on data of the same kind, or make it now."""
        if name not in self._made:
            self._made[name] = recalled(self._key, f"{name}, {'with' if self.keeps_history else 'no'} history", make)
        return self._made[name]

    def _compiled_start(self) -> Any:
        with _TRACING:
            lowered = self._starting.lower(*self._first_data())
        return compile_to_run_once(lowered, *_sizes(self.state))

    def _compiled_scan(self) -> Any:
        with _TRACING:
            lowered = self._programs.scan.lower(*self._scan_data(Start(self.state, self._begun), 0, 1))
        return compile_lowered(lowered, *_sizes(self.state))

    @cached_property
    def _key_data(self) -> NDArray[np.uint32]:
        return key_data(self._rng_key)

    def _blank(self, start: Start) -> tuple[Any, FilterInfo | None, StepOutput, int]:
        """Zeros in the shapes of the state, of its diagnosis by `init` and of what is kept, and how many bytes XLA's are."""
        rng_key, frame, constant = self._first_data()
        state, kept = self._programs.frame.eval_shape(rng_key, start, frame, constant)
        blank = jax.tree.map(lambda x: np.zeros((1, *x.shape), x.dtype), kept)
        state, begun = jax.tree.map(lambda x: np.zeros(x.shape, x.dtype), (state, start.info))
        return state, begun, tree_index(with_draws(self._collect, blank, self._key_data), 0), _bytes(blank)

    def _first_data(self) -> tuple[Any, ...]:
        return self._rng_key, tree_index(self._frames(0, 1, 1), 0), self._sequence.constant

    def _frames(self, start: int, stop: int, length: int) -> Frame:
        """Frames from `start` to `stop` with their keys, which are made for more at once; beyond, up to `length`, any."""
        if not self._keys_from <= start <= self._keys_from + _KEYS - (stop - start):
            self._keys = _keys_of_frames(self._rng_key, start)
            self._keys_from = start
        begin = start - self._keys_from
        keys = tree_index(self._keys, np.minimum(np.arange(begin, begin + length), _KEYS - 1))
        return Frame(keys, np.arange(start, start + length, dtype=np.int32), *self._sequence.rows(start, length))

    def _scan_data(self, start: Start, first: int, stop: int) -> tuple[Any, ...]:
        placed = start._replace(state=self.filter.to_devices(start.state))
        frames = self._frames(first, stop, self._length)
        return self._rng_key, placed, frames, np.int32(stop - first), self._sequence.constant


def _sizes(state: Any) -> tuple[int, int]:
    """How many particles a state has, and numbers in them; those of a Gaussian in its moments."""
    posterior = getattr(state, "posterior", None)
    if isinstance(posterior, Gaussian | RootGaussian):
        return 1, sum(np.size(part) for part in posterior)
    return np.size(state.log_weights), np.size(state.particles)


def _bytes(tree: Any) -> int:
    """Bytes of the arrays of a tree."""
    return sum(leaf.nbytes for leaf in jax.tree.leaves(tree))


def abstract_signature(data: Any) -> Any:
    """Key of compiled programs: structure, shapes, types and devices of the data, and type and device of new numbers."""
    leaves, structure = jax.tree.flatten(data)
    config: Any = jax.config
    new = jax.typeof(np.zeros(())), config.jax_default_device
    return structure, new, tuple((jax.typeof(leaf), getattr(leaf, "sharding", None)) for leaf in leaves)


def _on_host(result: tuple[Any, StepOutput], num_frames: int) -> tuple[Any, StepOutput]:
    """The frames of a call on the host; the state stays where it is."""
    state, kept = result
    return state, jax.tree.map(lambda leaf: np.asarray(leaf)[:num_frames], kept)
