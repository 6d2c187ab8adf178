"""The one driver: run a filter over a sequence, or feed it frame by frame.

    run = run_filter(filter, rng_key, observations, inputs, collect=collect)
    online = Online(filter, rng_key); state, info = online.update(observation, inputs)

A sequence of any length is one compilation of the filter's `init` and one of its `step`: frames go through a scan of a fixed
length, of which the last call, or the calls of a slow filter, use only a part. The key of a frame is folded from its number, so
that results depend neither on these parts nor on whether the frames came one by one. What is kept of a frame is what `collect`
returns for it; nothing else grows with the sequence.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, Literal, NamedTuple, Protocol
from weakref import WeakSet

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from poseppl.checkpoint import Checkpoint, Part, fingerprint
from poseppl.errors import PosepplError
from poseppl.filters.base import Filter, FilterState, Info
from poseppl.frame_sequence import Constant as Constant
from poseppl.frame_sequence import FrameSequence, Layout, frame_sequence
from poseppl.frame_sequence import frame_inputs as frame_inputs
from poseppl.program import Observation

Collect = Callable[[jax.Array, Any, Any, Any], Any]
"""`(rng_key, state, info, inputs) -> pytree of arrays`: what is kept of a frame; `info` is a filter's, or None."""

_LOGGER = logging.getLogger("poseppl")
_LONGEST = 64
"""Frames in one call at most, where their number adapts."""
_SAVED = 8
"""Frames in a part of a checkpoint, unless asked otherwise."""
_PATIENCE = 0.25
"""Seconds of a call up to which the next one takes twice as many frames."""
_STARTED: WeakSet[Any] = WeakSet()
"""The `step` functions that have been compiled, and so need not be compiled side by side with `init`."""


class RunError(PosepplError):
    """A run that cannot go on.

    Attributes:
        frame: The number of the frame.
    """

    def __init__(self, message: str, frame: int) -> None:
        super().__init__(message)
        self.frame = frame


class Progress(Protocol):
    """Who is told how a run goes."""

    def advance(self, frames: int) -> None:
        """So many more frames are done."""

    def note(self, message: str) -> None:
        """Something that the user should know."""


class Kept(NamedTuple):
    """What is kept of a frame; of a sequence, with a leading T.

    Attributes:
        outputs: What `collect` returned.
        info: The filter's diagnosis; its ``ancestors`` are left out (shape (T, 0)), for they are as many as the particles.
        unique_ancestors: How many particles of the frame before have offspring.
        finite: Whether all particles of positive weight were finite.
    """

    outputs: Any
    info: Info
    unique_ancestors: Any
    finite: Any


class Run(NamedTuple):
    """What a run returns, as NumPy arrays.

    Attributes:
        outputs: What `collect` kept, with a leading T.
        info: Diagnosis, with a leading T; ``ancestors`` are left out.
        unique_ancestors: (T,) how many particles of the frame before have offspring.
        state: The filter's state after the last frame.
        failed: Numbers of the frames whose data were impossible.
        compile_seconds: Time to trace and compile.
        wall_seconds: Time of the frames themselves.
        resumed: How many frames came from a checkpoint.
    """

    outputs: Any
    info: Info
    unique_ancestors: NDArray[np.int32]
    state: Any
    failed: tuple[int, ...]
    compile_seconds: float
    wall_seconds: float
    resumed: int


def _frame_keys(rng_key: jax.Array, frame: Any) -> tuple[jax.Array, jax.Array]:
    """Keys of the filter and of the collector at a frame."""
    key_filter, key_collect = jax.random.split(jax.random.fold_in(rng_key, frame))
    return key_filter, key_collect


def _keep(collect: Collect, rng_key: jax.Array, state: FilterState, info: Info, inputs: Any) -> Kept:
    offspring = jnp.zeros(info.ancestors.shape, jnp.int32).at[info.ancestors].set(1, mode="drop")
    alive = state.log_weights > -jnp.inf
    finite = jnp.all(jnp.isfinite(state.particles) | ~alive[..., None]) & ~jnp.any(jnp.isnan(state.log_weights))
    outputs = collect(rng_key, state, info, inputs)
    return Kept(outputs, info._replace(ancestors=jnp.zeros(0, jnp.int32)), jnp.sum(offspring), finite)


@partial(jax.jit, static_argnums=(0, 1, 2))
def _first(
    filter: Filter,
    collect: Collect,
    layout: Layout,
    rng_key: jax.Array,
    observation: Observation,
    varying: list[Any],
    constant: list[Any],
) -> tuple[Any, Kept]:
    """The first frame."""
    key_filter, key_collect = _frame_keys(rng_key, 0)
    inputs = layout.join(varying, constant)
    state, info = filter.init(key_filter, observation, inputs)
    return state, jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], _keep(collect, key_collect, state, info, inputs))


@partial(jax.jit, static_argnums=(0, 1, 2))
def _advance(
    filter: Filter,
    collect: Collect,
    layout: Layout,
    state: Any,
    blank: Kept,
    rng_key: jax.Array,
    frames: jax.Array,
    active: jax.Array,
    observations: Observation,
    varying: list[Any],
    constant: list[Any],
) -> tuple[Any, Kept]:
    """Later frames of the numbers `frames` (chunk,), of which the `active` (chunk,) ones count."""

    def body(state: Any, row: Any) -> tuple[Any, Kept]:
        frame, wanted, observation, varying = row

        def run(state: Any) -> tuple[Any, Kept]:
            key_filter, key_collect = _frame_keys(rng_key, frame)
            inputs = layout.join(varying, constant)
            new, info = filter.step(key_filter, state, observation, inputs)
            return new, _keep(collect, key_collect, new, info, inputs)

        result: tuple[Any, Kept] = jax.lax.cond(wanted, run, lambda old: (old, blank), state)
        return result

    return jax.lax.scan(body, state, (frames, active, observations, varying))


def run_filter(
    filter: Filter,
    rng_key: jax.Array,
    observations: Observation,
    inputs: Any = None,
    *,
    collect: Collect,
    num_frames: int | None = None,
    chunk: int | None = None,
    progress: Progress | None = None,
    checkpoint: Checkpoint | None = None,
    on_failure: Literal["continue", "stop"] = "continue",
    frame_numbers: Sequence[int] | None = None,
) -> Run:
    """Run a filter over a sequence.

    Args:
        filter: The filter.
        rng_key: PRNG key; the same key gives the same result.
        observations: Data with a leading T.
        inputs: Inputs with a leading T, constant parts wrapped in :class:`Constant`; None where the model takes none.
        collect: `(rng_key, state, info, inputs of the frame) -> pytree`, what is kept of a frame; see :mod:`poseppl.collect`.
        num_frames: T; as many as there are data if None.
        chunk: Frames between two reports of progress and two parts of a checkpoint; results do not depend on it. If None, 8
            with a checkpoint, else as many as take about a quarter of a second, from 8 to 64.
        progress: Who is told.
        checkpoint: Where the run is saved after each chunk, and resumed from.
        on_failure: What to do at a frame whose data are impossible: "continue" from its prediction, or "stop".
        frame_numbers: Numbers of the frames in messages; 0, 1, ... if None.

    Returns:
        What was kept, and how it went.

    Raises:
        ValueError: An array does not have T rows.
        RunError: A frame failed and `on_failure` is "stop", or a state is not finite.
        CheckpointError: The checkpoint belongs to another run.
    """
    sequence = frame_sequence(observations, inputs, num_frames)
    num_frames = sequence.num_frames
    if chunk is not None and chunk < 1:
        raise ValueError(f"chunk is {chunk}; it must be at least 1")
    adapts = chunk is None and checkpoint is None
    length = chunk or (_LONGEST if adapts else _SAVED)
    note = progress.note if progress else _LOGGER.warning
    numbers = list(range(num_frames)) if frame_numbers is None else [int(number) for number in frame_numbers]
    started = time.perf_counter()
    state, blank = _blank(filter, collect, sequence, rng_key)
    parts: list[Part] = []
    if checkpoint is not None:
        data = (sequence.observations, sequence.varying, sequence.constant, jax.random.key_data(rng_key))
        checkpoint.open(fingerprint(data, chunk=length, num_frames=num_frames, state=state))
        parts = checkpoint.load(_spans(num_frames, length), state, blank, note)
    resumed = sum(len(part.kept.finite) for part in parts)
    first = _compile(filter, collect, sequence, (state, blank), rng_key, length, resumed == 0)
    compiled = time.perf_counter()
    ready, stop, pace = iter(parts[:]), 0, _SAVED if adapts else length
    while stop < num_frames:
        start, began = stop, time.perf_counter()
        part = next(ready, None)
        is_new = part is None
        if part is None:
            stop = min(start + pace, num_frames) if start else 1
            part = first or _advanced(filter, collect, sequence, parts[-1], blank, rng_key, start, stop, length)
            if first is None and adapts and time.perf_counter() - began < _PATIENCE:
                pace = min(2 * pace, length)
            first = None
            if parts:
                parts[-1] = parts[-1]._replace(state=None)
            parts.append(part)
        stop = start + len(part.kept.finite)
        _check(part.kept, start, numbers, on_failure, note)
        if checkpoint is not None and is_new:
            checkpoint.save(start, stop, part)
        if progress:
            progress.advance(stop - start)
    whole: Kept = jax.tree.map(lambda *leaves: np.concatenate(leaves), *(part.kept for part in parts))
    failed = tuple(numbers[index] for index in np.flatnonzero(whole.info.failed))
    seconds = compiled - started, time.perf_counter() - compiled
    last = jax.tree.map(np.asarray, parts[-1].state)
    return Run(whole.outputs, whole.info, whole.unique_ancestors, last, failed, *seconds, resumed)


def _spans(num_frames: int, chunk: int) -> list[tuple[int, int]]:
    """The first frame alone, then chunks: pairs of the first frame and the one after the last."""
    return [(0, 1)] + [(start, min(start + chunk, num_frames)) for start in range(1, num_frames, chunk)]


def _blank(filter: Filter, collect: Collect, sequence: FrameSequence, rng_key: jax.Array) -> tuple[Any, Kept]:
    """A state, and what is kept of a frame, of the right shapes; nothing is compiled."""
    observation, varying = sequence.frame(0)
    trace: Any = _first
    shapes = trace.eval_shape(filter, collect, sequence.layout, rng_key, observation, varying, sequence.constant)
    state, kept = jax.tree.map(lambda leaf: np.zeros(leaf.shape, leaf.dtype), shapes)
    return state, jax.tree.map(lambda leaf: leaf[0], kept)


def _compile(
    filter: Filter,
    collect: Collect,
    sequence: FrameSequence,
    blank: tuple[Any, Kept],
    rng_key: jax.Array,
    chunk: int,
    first: bool,
) -> Part | None:
    """Compile both programs side by side; the first frame is run, if it is wanted, and the later ones are not."""
    observation, varying = sequence.frame(0)
    arguments = (filter, collect, sequence.layout, rng_key, observation, varying, sequence.constant)
    if filter.step in _STARTED:
        return _part(_first(*arguments), 1) if first else None
    _STARTED.add(filter.step)
    with ThreadPoolExecutor(1) as pool:
        running = pool.submit(_first, *arguments) if first else None
        if sequence.num_frames > 1:
            rows, varying = sequence.rows(1, chunk)
            none = np.zeros(chunk, np.int32), np.zeros(chunk, bool)
            _advance(filter, collect, sequence.layout, *blank, rng_key, *none, rows, varying, sequence.constant)
        if running is None:
            return None
        return _part(running.result(), 1)


def _advanced(
    filter: Filter,
    collect: Collect,
    sequence: FrameSequence,
    last: Part,
    blank: Kept,
    rng_key: jax.Array,
    start: int,
    stop: int,
    chunk: int,
) -> Part:
    """The frames from `start` up to `stop`, after the part before them."""
    rows, varying = sequence.rows(start, chunk)
    numbers = np.arange(start, start + chunk, dtype=np.int32)
    bounds = numbers, numbers < stop
    return _part(
        _advance(filter, collect, sequence.layout, last.state, blank, rng_key, *bounds, rows, varying, sequence.constant),
        stop - start,
    )


def _part(result: tuple[Any, Kept], num_frames: int) -> Part:
    """The frames of a call on the host; the state stays where it is."""
    state, kept = result
    return Part(jax.tree.map(lambda leaf: np.asarray(leaf)[:num_frames], kept), state)


def _check(kept: Kept, start: int, numbers: list[int], on_failure: str, note: Callable[[str], None]) -> None:
    for index in range(len(kept.finite)):
        number = numbers[start + index]
        if not kept.finite[index]:
            raise RunError(
                f"frame {number}: the filter's state is not finite; its model or settings break down there, and nothing "
                "after it could be trusted (try a smaller step size, or check the model's densities)",
                number,
            )
        if kept.info.failed[index]:
            problem = f"frame {number}: the data are impossible under the model (every weight is zero or NaN)"
            if on_failure == "stop":
                raise RunError(f"{problem}; stopped there, as asked", number)
            note(f"{problem}; the frame is predicted, not updated")


class Online:
    """A filter fed frame by frame; each method compiles once. It gives what :func:`run_filter` gives with the same key.

    Args:
        filter: The filter.
        rng_key: PRNG key.
    """

    def __init__(self, filter: Filter, rng_key: jax.Array) -> None:
        self._rng_key = rng_key
        self._init = jax.jit(filter.init)
        self._step = jax.jit(filter.step)
        self.frame = 0
        self.state: Any = None

    def update(self, observation: Observation, inputs: Any = None) -> tuple[Any, Info]:
        """Take the next frame.

        Args:
            observation: Data of the frame.
            inputs: Inputs of the frame.

        Returns:
            The new state and the diagnosis; a failed frame is told by ``info.failed``, as values inside jit cannot raise.
        """
        key, _ = _frame_keys(self._rng_key, self.frame)
        if self.frame == 0:
            self.state, info = self._init(key, observation, inputs)
        else:
            self.state, info = self._step(key, self.state, observation, inputs)
        self.frame += 1
        return self.state, info
