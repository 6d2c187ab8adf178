"""A run whose frames come one after the other, as from a detector that is at work.

    run = OnlineRun(filter, rng_key, observations, inputs, collect=collect, note=print)  # the first frames
    outputs = run.add(observations, inputs).outputs                                      # some more, of the same shapes
    whole = run.finish()

It is made of the frames of :func:`poseppl.runs.run.run_filter`, compiled once, and gives the same numbers within float
rounding.
:class:`poseppl.runs.online.Online` is the lighter one, which keeps the filter's state alone.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from jax import Array

from poseppl.files.store import Note
from poseppl.filters.base import Filter
from poseppl.filters.scan import Collect
from poseppl.particles.stacks import tree_index
from poseppl.program import Observation
from poseppl.program.earlier_data import EarlierDataModel, WithEarlier
from poseppl.program.earlier_inputs import following, with_earlier_data
from poseppl.program.frame_inputs import coarse_inputs
from poseppl.program.observation import check_frame_shapes
from poseppl.runs.compiled_scan import CompiledRun
from poseppl.runs.course import FilterRun, OnFailure, Run
from poseppl.runs.frame_sequence import FrameSequence, frame_inputs, frame_sequence
from poseppl.runs.predictive import Predict
from poseppl.runs.step_output import StepOutput


class OnlineRun:
    """A run that is online: its frames are filtered as they come.

    Args:
        filter: The filter.
        rng_key: PRNG key; the same key gives the same result.
        observations: Data of the first frames, with a leading T.
        inputs: Inputs, as :func:`poseppl.runs.run.run_filter` takes them; constant ones are those of all frames.
        collect: Collector of each frame.
        predict: Predictive checks of each frame's data.
        on_failure: Action at a frame with zero likelihood.
        note: Receives messages for the user.
        frame_numbers: Numbers of the frames in messages; 0, 1, ... if None.

    Raises:
        ValueError: As :func:`poseppl.runs.run.run_filter`.
        RunError: As there.
    """

    def __init__(
        self,
        filter: Filter,
        rng_key: Array,
        observations: Observation,
        inputs: Any = None,
        *,
        collect: Collect,
        predict: Predict | None = None,
        on_failure: OnFailure = "continue",
        note: Note,
        frame_numbers: Sequence[int] | None = None,
    ) -> None:
        started = time.perf_counter()
        self._filter = filter
        self._numbers: list[int] = []
        self._before: WithEarlier | None = None
        sequence = self._sequence(observations, inputs)
        self._calls = CompiledRun(filter, collect, predict, sequence, rng_key)
        self._course = FilterRun(self._calls, self._numbers, on_failure, note, started)
        self._course.warn(*coarse_inputs(inputs))
        self._course.compile(resumed=0)
        self._seconds = self._processor = 0.0
        self.first = self._advance(sequence, frame_numbers)
        """Outputs of the first frames."""

    def add(self, observations: Observation, inputs: Any = None, frame_numbers: Sequence[int] | None = None) -> StepOutput:
        """Take more frames; what is kept of them.

        Raises:
            ValueError: An array does not have T rows, or the inputs are others than those of the first frames.
            RunError: A frame failed and `on_failure` is "stop", or a state is not finite, computed twice.
        """
        sequence = self._sequence(observations, inputs)._replace(before=self._course.stop)
        self._calls.feed(sequence)
        return self._advance(sequence, frame_numbers)

    def finish(self) -> Run:
        """The whole run; the seconds of its frames are those in which they were computed."""
        return self._course.finish()._replace(wall_seconds=self._seconds, cpu_seconds=self._processor)

    def _sequence(self, observations: Observation, inputs: Any) -> FrameSequence:
        model = self._filter.model
        given = with_earlier_data(model, observations, inputs, self._before)
        sequence = frame_sequence(observations, given, None)
        if model is not None:
            check_frame_shapes(model.observation_sites, sequence.observations, sequence.num_frames)
        if isinstance(model, EarlierDataModel):
            last = sequence.num_frames - 1
            self._before = following(model, frame_inputs(given, last), tree_index(sequence.observations, last))
        return sequence

    def _advance(self, sequence: FrameSequence, numbers: Sequence[int] | None) -> StepOutput:
        stop = self._course.stop + sequence.num_frames
        self._numbers += range(self._course.stop, stop) if numbers is None else [int(number) for number in numbers]
        began, processor = time.perf_counter(), time.process_time()
        _, kept = self._course.advance(stop)
        self._seconds += time.perf_counter() - began
        self._processor += time.process_time() - processor
        return kept
