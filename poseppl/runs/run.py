"""The one driver: run a filter over a sequence.

    run = run_filter(filter, rng_key, observations, inputs, collect=collect)

A sequence of any length is one compilation of the filter's `init` and one of its `step`, or of `step` alone where a filter
tells its state before the first frame: frames go through a scan of a fixed length, of which the last call, or the calls of a
slow filter, use only a part. The key of a frame is folded from its number, so that results depend neither on these parts nor
on whether the frames came one by one. What is kept of a frame is what `collect` returns for it; nothing else grows with the
sequence.
"""

from __future__ import annotations

import itertools
import logging
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from typing import Any, Literal, NamedTuple, Protocol

import jax
import numpy as np
from numpy.typing import NDArray

from poseppl.checks import check_at_least
from poseppl.errors import PosepplError
from poseppl.filters.base import Filter, Info
from poseppl.program import Observation
from poseppl.program.observation import check_frame_shapes
from poseppl.runs.checkpoint import Checkpoint, Part, fingerprint
from poseppl.runs.compiled_scan import Calls
from poseppl.runs.compiled_scan import Collect as Collect
from poseppl.runs.compiled_scan import Kept as Kept
from poseppl.runs.frame_sequence import Constant as Constant
from poseppl.runs.frame_sequence import frame_inputs as frame_inputs
from poseppl.runs.frame_sequence import frame_sequence
from poseppl.runs.predictive import Predict, Prediction

_LOGGER = logging.getLogger("poseppl")
_LONGEST = 64
"""Frames in one call at most, where their number adapts."""
_SAVED = 8
"""Frames in a part of a checkpoint, unless asked otherwise."""
_COLLAPSED, _MANY = 2, 10
"""A filter of at least so many particles has collapsed where fewer than two are effective."""
_PATIENCE = 0.25
"""Seconds of a call up to which the next one takes twice as many frames."""


class RunError(PosepplError):
    """A run that cannot go on.

    Attributes:
        frame: The number of the frame.
        done: The run up to the frame before; None where there is no such frame, or a checkpoint holds it already.
    """

    def __init__(self, message: str, frame: int, done: Run | None = None) -> None:
        super().__init__(message)
        self.frame, self.done = frame, done


class Progress(Protocol):
    """Who is told how a run goes."""

    def advance(self, frames: int) -> None:
        """So many more frames are done."""

    def note(self, message: str) -> None:
        """Something that the user should know."""


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
        prediction: Each frame's data against their prediction, with a leading T; None if that was not asked for.
    """

    outputs: Any
    info: Info
    unique_ancestors: NDArray[np.int32]
    state: Any
    failed: tuple[int, ...]
    compile_seconds: float
    wall_seconds: float
    resumed: int
    prediction: Prediction | None = None


def run_filter(
    filter: Filter,
    rng_key: jax.Array,
    observations: Observation,
    inputs: Any = None,
    *,
    collect: Collect,
    predict: Predict | None = None,
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
        collect: `(rng_key, state, info, inputs of the frame) -> pytree`, what is kept of a frame; see
            :mod:`poseppl.runs.collectors`.
        predict: Predictive checks of each frame's data, of :func:`poseppl.runs.predictive.predictive_checks`; what the
            filter does and what is collected do not depend on them.
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
        ValueError: The data are no Observation, an array does not have T rows, or the inputs are not those that the model was
            compiled for.
        RunError: A frame failed and `on_failure` is "stop", or a state is not finite, computed twice; it holds the run so far.
        CheckpointError: The checkpoint belongs to another run, or another process is at it.
    """
    sequence = frame_sequence(observations, inputs, num_frames)
    num_frames = sequence.num_frames
    if filter.model is not None:
        check_frame_shapes(filter.model.observation_sites, sequence.observations, num_frames)
    if chunk is not None:
        check_at_least(1, chunk=chunk)
    adapts = chunk is None and checkpoint is None
    length = chunk or (_LONGEST if adapts else _SAVED)
    note = progress.note if progress else _LOGGER.warning
    numbers = list(range(num_frames)) if frame_numbers is None else [int(number) for number in frame_numbers]
    started = time.perf_counter()
    calls = Calls(filter, collect, predict, sequence, rng_key)
    saved: list[Part] = []
    with checkpoint or nullcontext():
        if checkpoint is not None:
            data = (sequence.observations, sequence.varying, sequence.constant, jax.random.key_data(rng_key))
            checkpoint.open(fingerprint(data, chunk=length, num_frames=num_frames, state=calls.state), note)
            saved = checkpoint.load(_spans(num_frames, length), calls.state, calls.blank)
        resumed = sum(len(part.kept.finite) for part in saved)
        calls.compile(first=not saved)
        compiled = time.perf_counter()
        kept: list[Kept] = []
        state, stop, pace = None, 0, _SAVED if adapts else length
        for part in itertools.chain(saved, itertools.repeat(None)):
            start, began = stop, time.perf_counter()
            if part is None:
                part = _advance(calls, state, start, min(start + pace, num_frames) if start else 1, numbers, note)
                if adapts and start and time.perf_counter() - began < _PATIENCE:
                    pace = min(2 * pace, length)
            fault = _fault(part.kept, start, numbers, on_failure, note)
            if fault is not None:
                good, problem = fault
                if good and state is not None:  # the frames before it, for the state after them
                    head = calls.advance(state, start, start + good)
                    state, kept = head.state, [*kept, head.kept]
                seconds = compiled - started, time.perf_counter() - compiled
                done = None if state is None else _assemble(kept, state, numbers, seconds, resumed)
                raise RunError(problem, numbers[start + good], done)
            state, stop = part.state, start + len(part.kept.finite)
            kept.append(part.kept)
            if checkpoint is not None and stop > resumed:
                checkpoint.save(start, stop, part)
            if progress:
                progress.advance(stop - start)
            if stop == num_frames:
                break
    run = _assemble(kept, state, numbers, (compiled - started, time.perf_counter() - compiled), resumed)
    _tell_collapse(run, numbers, note)
    return run


def _tell_collapse(run: Run, numbers: list[int], note: Callable[[str], None]) -> None:
    """Tell at which frames hardly a particle has weight."""
    count = run.state.particles.shape[0]
    low = np.flatnonzero((run.info.ess < _COLLAPSED) & ~run.info.failed)
    if run.state.particles.ndim != 2 or count < _MANY or not low.size:
        return
    others = f" and {low.size - 1} other frames" if low.size > 1 else ""
    note(
        f"frame {numbers[low[0]]}{others}: fewer than {_COLLAPSED} of {count} particles are effective; what the filter tells "
        "rests on one particle (take more, or a filter that looks at the data first, such as the auxiliary or tempered one)"
    )


def _assemble(kept: list[Kept], state: Any, numbers: list[int], seconds: tuple[float, float], resumed: int) -> Run:
    whole: Kept = jax.tree.map(lambda *leaves: np.concatenate(leaves), *kept)
    failed = tuple(numbers[index] for index in np.flatnonzero(whole.info.failed))
    last = jax.tree.map(np.asarray, state)
    return Run(whole.outputs, whole.info, whole.unique_ancestors, last, failed, *seconds, resumed, whole.prediction)


def _spans(num_frames: int, chunk: int) -> list[tuple[int, int]]:
    """The first frame alone, then chunks: pairs of the first frame and the one after the last."""
    return [(0, 1)] + [(start, min(start + chunk, num_frames)) for start in range(1, num_frames, chunk)]


def _advance(calls: Calls, state: Any, start: int, stop: int, numbers: list[int], note: Callable[[str], None]) -> Part:
    """Some frames; those whose state is not finite are computed twice.

    The same program gives the same numbers, but for faults of the machine and of XLA, some of whose programs on the CPU were
    seen to differ from call to call (https://github.com/jax-ml/jax/issues/39741). A model that breaks down does so again.
    """
    part = calls.advance(state, start, stop)
    if np.all(part.kept.finite):
        return part
    again = calls.advance(state, start, stop)
    if np.all(again.kept.finite):
        note(f"frames {numbers[start]} to {numbers[stop - 1]}: a state was not finite, and is when computed again; going on")
    return again


def _fault(kept: Kept, start: int, numbers: list[int], on_failure: str, note: Callable[[str], None]) -> tuple[int, str] | None:
    """How many frames come before the one at which the run cannot go on, and why; None where it can."""
    for index in range(len(kept.finite)):
        number = numbers[start + index]
        if not kept.finite[index]:
            return index, not_finite_message(number)
        if kept.info.failed[index]:
            problem = f"frame {number}: the data are impossible under the model (every weight is zero or NaN)"
            if on_failure == "stop":
                return index, f"{problem}; stopped there, as asked"
            note(f"{problem}; the frame is predicted, not updated")
    return None


def not_finite_message(frame: int) -> str:
    """What is said of a frame after which nothing can be trusted."""
    return (
        f"frame {frame}: the filter's state is not finite; its model or settings break down there, and nothing after it could "
        "be trusted (try a smaller step size, or check the model's densities)"
    )
