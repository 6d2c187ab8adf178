"""The one driver: run a filter over a sequence.

    run = run_filter(filter, rng_key, observations, inputs, collect=collect)

A sequence of any length needs one compilation of the filter's `init` and one of its `step` with the collector. A filter that
has a state before the first frame needs only the second. Frames go through a scan of a fixed length; the last call, and the
calls of a slow filter, use only a part of it. The key of a frame is folded from its number, so that results depend neither on
these parts nor on whether the frames came one by one. A frame leaves what `collect` returns for it; nothing else grows with the
sequence.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from typing import Any, Protocol

import jax
from jax import Array

from poseppl.checks import check_at_least, check_key
from poseppl.filters.base import Filter
from poseppl.filters.scan import Collect as Collect
from poseppl.program import Observation
from poseppl.program.earlier_inputs import with_earlier_data
from poseppl.program.frame_inputs import coarse_inputs
from poseppl.program.observation import check_frame_shapes
from poseppl.runs.checkpoint import Checkpoint, fingerprint
from poseppl.runs.compiled_scan import CompiledRun
from poseppl.runs.course import FilterRun, OnFailure, Run as Run, RunError as RunError
from poseppl.runs.filter_history import MIB, no_room
from poseppl.runs.frame_sequence import Constant as Constant, FrameSequence, frame_inputs as frame_inputs, frame_sequence
from poseppl.runs.predictive import Predict
from poseppl.runs.step_output import StepOutput as StepOutput

_LOGGER = logging.getLogger("poseppl")
_LONGEST = 512
"""Frames in one call at most, where their number adapts."""
_SAVED = 8
"""Frames in a part of a checkpoint, unless asked otherwise."""
_TARGET_CHUNK_SECONDS = 0.25
"""Seconds that a call may take where the number of its frames adapts."""


class Progress(Protocol):
    """Reports how a run goes."""

    def advance(self, frames: int) -> None:
        """So many more frames are done."""

    def note(self, message: str) -> None:
        """Something that the user should know."""


def run_filter(
    filter: Filter,
    rng_key: Array,
    observations: Observation,
    inputs: Any = None,
    *,
    collect: Collect,
    predict: Predict | None = None,
    num_frames: int | None = None,
    chunk: int | None = None,
    progress: Progress | None = None,
    checkpoint: Checkpoint | None = None,
    on_failure: OnFailure = "continue",
    frame_numbers: Sequence[int] | None = None,
    history_mib: float = 0,
) -> Run:
    """Run a filter over a sequence.

    Args:
        filter: The filter.
        rng_key: PRNG key; the same key gives the same result.
        observations: Data with a leading T.
        inputs: Inputs with a leading T, constant parts wrapped in :class:`Constant`; None where the model takes none.
        collect: `(rng_key, state, info, inputs of the frame) -> pytree`, what is kept of a frame; see
            :mod:`poseppl.runs.collectors`.
        predict: Checks of each frame's data, of :func:`poseppl.runs.predictive.predictive_checks`; nothing else needs them.
        num_frames: T; as many as there are data if None.
        chunk: Frames between two reports of progress and two parts of a checkpoint; results do not depend on it. If None, 8
            with a checkpoint, else as many as take about a quarter of a second, from 8 to 512.
        progress: Reports the run's progress.
        checkpoint: Folder to which the run is saved after each chunk, and from which it is resumed.
        on_failure: Action at a frame with zero likelihood: "continue" from its prediction, or "stop".
        frame_numbers: Numbers of the frames in messages; 0, 1, ... if None.
        history_mib: Room for the :mod:`poseppl.runs.filter_history`, MiB; one that needs more is not kept, with a note.

    Returns:
        The collected outputs, and the record of the run.

    Raises:
        ValueError: The data are no Observation, an array does not have T rows, or the inputs are not those that the model was
            compiled for.
        RunError: A frame failed and `on_failure` is "stop", or a state is not finite, computed twice; it holds the run so far.
        CheckpointError: The checkpoint belongs to another run, or another process is at it.
    """
    check_key(rng_key)
    given = with_earlier_data(filter.model, observations, inputs)
    sequence = frame_sequence(observations, given, num_frames)
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
    calls = CompiledRun(filter, collect, predict, sequence, rng_key, history_bytes=history_mib * MIB)
    course = FilterRun(calls, numbers, on_failure, note, started)
    if calls.history_bytes > history_mib * MIB > 0:
        course.warn(no_room(calls.history_bytes / MIB, history_mib))
    course.warn(*coarse_inputs(inputs))
    with checkpoint or nullcontext():
        saved = [] if checkpoint is None else _saved(checkpoint, sequence, rng_key, calls, length, note)
        course.compile(resumed=sum(len(kept.finite) for _, kept in saved))
        for state, kept in saved:
            course.take(state, kept)
            if progress:
                progress.advance(len(kept.finite))
        _go_on(course, calls, num_frames, length, checkpoint, progress, adapts)
    return course.finish()


def _go_on(
    course: FilterRun,
    calls: CompiledRun,
    num_frames: int,
    length: int,
    checkpoint: Checkpoint | None,
    progress: Progress | None,
    adapts: bool,
) -> None:
    """Run the frames that are left, in parts of this length, or as many at a time as take about a quarter of a second.

    The first frame is a part of its own, unless an earlier run has measured how long frames take.
    """
    first = adapts and calls.seconds is not None
    pace = _pace(calls.seconds, length) if adapts else length
    while course.stop < num_frames:
        start, began = course.stop, time.perf_counter()
        state, kept = course.advance(min(start + pace, num_frames) if start or first else 1)
        if adapts:
            calls.seconds = (time.perf_counter() - began) / (course.stop - start)
            pace = _pace(calls.seconds, length)
        if checkpoint is not None:
            checkpoint.save(start, course.stop, state, kept)
        if progress:
            progress.advance(course.stop - start)


def _pace(seconds: float | None, length: int) -> int:
    """How many frames take about a quarter of a second, if one takes so many seconds; few where that is unknown."""
    return _SAVED if seconds is None else min(max(int(_TARGET_CHUNK_SECONDS / max(seconds, 1e-9)), _SAVED), length)


def _saved(
    checkpoint: Checkpoint,
    sequence: FrameSequence,
    rng_key: Array,
    calls: CompiledRun,
    length: int,
    note: Callable[[str], None],
) -> list[tuple[Any, StepOutput]]:
    """Open a checkpoint, and load the parts that it holds of this run."""
    data = (sequence.observations, sequence.varying, sequence.constant, jax.random.key_data(rng_key))
    known = {"num_frames": sequence.num_frames, "state": calls.state, "history": calls.keeps_history}
    checkpoint.open(fingerprint(data, chunk=length, **known), note)
    return checkpoint.load(_spans(sequence.num_frames, length), calls.state, calls.blank)


def _spans(num_frames: int, chunk: int) -> list[tuple[int, int]]:
    """The first frame alone, then chunks: pairs of the first frame and the one after the last."""
    return [(0, 1)] + [(start, min(start + chunk, num_frames)) for start in range(1, num_frames, chunk)]
