"""A run under way: what is kept of the frames so far, the filter's state after them, and where it cannot go on."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from poseppl.errors import PosepplError
from poseppl.files.store import Note
from poseppl.filters.base import FilterInfo
from poseppl.filters.suitability import compatible_filters
from poseppl.program import CompiledModel
from poseppl.program.large_integers import overflow_message, overflown
from poseppl.runs.compiled_scan import CompiledRun
from poseppl.runs.predictive import Prediction
from poseppl.runs.step_output import StepOutput, joined

OnFailure = Literal["continue", "stop"]
_COLLAPSED, _MANY = 2, 10
"""A filter of at least so many particles has collapsed where fewer than two are effective."""
FEW = 10.0
"""Effective number of particles below which they miss the posterior."""


class RunError(PosepplError):
    """A run that cannot go on.

    Attributes:
        frame: The number of the frame.
        done: The run up to the frame before; None where there is no such frame, or a checkpoint holds it already.
    """

    def __init__(self, message: str, frame: int, done: Run | None = None) -> None:
        super().__init__(message)
        self.frame, self.done = frame, done


class Run(NamedTuple):
    """Result of a run, as NumPy arrays.

    Attributes:
        outputs: Output of `collect`, with a leading T.
        info: Diagnosis, with a leading T; ``ancestors`` are left out.
        unique_ancestors: (T,) how many particles of the frame before have offspring.
        state: The filter's state after the last frame.
        failed: Numbers of the frames whose data were impossible.
        compile_seconds: Time to trace and compile.
        wall_seconds: Time of the frames themselves.
        resumed: How many frames came from a checkpoint.
        method: Properties that the filter declares, by name, for the result.
        prediction: Each frame's data against their prediction, with a leading T; None if that was not asked for.
        history: Record of the filter for smoothers, see :mod:`poseppl.runs.filter_history`; None if it is not kept.
        warnings: Warnings of the run, except those for the frames in ``failed``.
        cpu_seconds: Processor time of the frames themselves, of all threads of the process.
    """

    outputs: Any
    info: FilterInfo
    unique_ancestors: NDArray[np.int32]
    state: Any
    failed: tuple[int, ...]
    compile_seconds: float
    wall_seconds: float
    resumed: int
    method: Mapping[str, Any]
    prediction: Prediction | None = None
    history: Any = None
    warnings: tuple[str, ...] = ()
    cpu_seconds: float = float("nan")


class FilterRun:
    """A run under way.

    Args:
        calls: The compiled calls and their data.
        numbers: Numbers of the frames, for messages.
        on_failure: Action at a frame of impossible data.
        note: Receives messages for the user.
        started: When the run began, by :func:`time.perf_counter`.

    Attributes:
        stop: How many frames are done.
        resumed: How many of them came from a checkpoint.
    """

    def __init__(self, calls: CompiledRun, numbers: Sequence[int], on_failure: OnFailure, note: Note, started: float) -> None:
        self._calls, self._numbers, self._on_failure, self._note = calls, numbers, on_failure, note
        self._started = self._compiled = started
        self._processor = time.process_time()
        self._state: Any = None
        self._kept: list[StepOutput] = []
        self._warnings: list[str] = []
        self.stop = self.resumed = 0

    def warn(self, *messages: str) -> None:
        """Tell the user, and remember it for the result."""
        for message in messages:
            self._warnings.append(message)
            self._note(message)

    def compile(self, resumed: int) -> None:
        """Compile what the frames need after so many that come from a checkpoint."""
        self.resumed = resumed
        self._calls.compile(first=not resumed)
        self._compiled, self._processor = time.perf_counter(), time.process_time()

    def advance(self, stop: int) -> tuple[Any, StepOutput]:
        """Go on up to `stop`: the filter's state there, and what is kept of the frames.

        Frames whose state is not finite are computed twice.
        The same program gives the same numbers, except for faults of the machine and of XLA. Some of XLA's programs on the CPU
        differ from call to call (https://github.com/jax-ml/jax/issues/39741). A model that is itself at fault fails again.

        Raises:
            RunError: As :meth:`take`.
        """
        start, numbers = self.stop, self._numbers
        state, kept = self._calls.advance(self._state, start, stop)
        if not np.all(kept.finite):
            state, kept = self._calls.advance(self._state, start, stop)
            if np.all(kept.finite):
                where = f"frames {numbers[start]} to {numbers[stop - 1]}: a state was not finite, and is when computed again"
                self.warn(f"{where}; going on")
        self.take(state, kept)
        return state, kept

    def take(self, state: Any, kept: StepOutput) -> None:
        """Go on from frames that are done: the state after them, and what was kept of them.

        Raises:
            RunError: The run cannot go on at one of them; it holds the run so far.
        """
        fault = self._fault(kept)
        if fault is not None:
            raise self._error(*fault)
        self._state, self.stop = state, self.stop + len(kept.finite)
        self._kept.append(kept)

    def finish(self) -> Run:
        """The whole run."""
        run = self._run(self._kept, self._state)
        collapse = _collapse(run, self._numbers)
        if collapse:
            self.warn(collapse)
        return run._replace(warnings=tuple(self._warnings))

    def _fault(self, kept: StepOutput) -> tuple[int, str] | None:
        """How many frames come before the one at which the run cannot go on, and why; None where it can."""
        for index in np.flatnonzero(~kept.finite | kept.info.failed).tolist():
            number = self._numbers[self.stop + index]
            if not kept.finite[index]:
                return index, self._breakdown(index) + self._about_inputs(index)
            if kept.info.failed[index]:
                problem = f"frame {number}: the data are impossible under the model (every weight is zero or NaN)"
                problem += self._about_inputs(index)
                if self._on_failure == "stop":
                    return index, f"{problem}; stopped there, as asked"
                self._note(f"{problem}; the frame is predicted, not updated")
        return None

    def _breakdown(self, index: int) -> str:
        """Why the state after a frame cannot be gone on from."""
        state, _ = self._calls.advance(self._state, self.stop, self.stop + index + 1)
        return breakdown_message(self._numbers[self.stop + index], state, self._calls.filter.model)

    def _about_inputs(self, index: int) -> str:
        finite = self._calls.inputs_are_finite(self.stop + index)
        return "" if finite else "; an input of this frame is NaN or infinite, where only data may be missing"

    def _error(self, good: int, problem: str) -> RunError:
        kept, state = self._kept, self._state
        if good:  # the frames before it, for the state after them
            state, head = self._calls.advance(state, self.stop, self.stop + good)
            kept = [*kept, head]
        done = None if state is None else self._run(kept, state)
        return RunError(problem, self._numbers[self.stop + good], done)

    def _run(self, kept: list[StepOutput], state: Any) -> Run:
        seconds = self._compiled - self._started, time.perf_counter() - self._compiled
        whole = kept[0] if len(kept) == 1 else joined(kept)
        failed = tuple(self._numbers[index] for index in np.flatnonzero(whole.info.failed).tolist())
        timing = (*seconds, self.resumed, self._method(whole.info, state))
        last = jax.tree.map(np.asarray, state)
        parts = whole.outputs, whole.info, whole.unique_ancestors, last, failed, *timing, whole.prediction, whole.history
        return Run(*parts, tuple(self._warnings), time.process_time() - self._processor)

    def _method(self, info: FilterInfo, state: Any) -> Mapping[str, Any]:
        """Properties that the filter declares; if its particles miss the posterior, also filters that suit its model."""
        filter = self._calls.filter
        weighted = state.log_weights.ndim == 1 and not filter.closed_form
        few = weighted and bool((np.asarray(info.ess) < FEW).any())
        misses = few or filter.is_optimizer or filter.points is not None
        if filter.model is None or not misses:
            return filter.provenance
        return {**filter.provenance, "suited filters": list(compatible_filters(filter.model))}


def _collapse(run: Run, numbers: Sequence[int]) -> str | None:
    """A sentence on the frames at which hardly a particle has weight, if there are any."""
    count = run.state.log_weights.shape[0]
    low = np.flatnonzero((run.info.ess < _COLLAPSED) & ~run.info.failed)
    if run.state.log_weights.ndim != 1 or count < _MANY or not low.size:
        return None
    others = f" and {low.size - 1} other frames" if low.size > 1 else ""
    return (
        f"frame {numbers[low[0]]}{others}: fewer than {_COLLAPSED} of {count} particles are effective; the filter's result "
        "depends on one particle (use more particles, or a filter that uses the data in its proposal)"
    )


def breakdown_message(frame: int, state: Any, model: CompiledModel | None) -> str:
    """Message of a frame after which nothing can be trusted.

    Args:
        frame: Its number.
        state: The filter's state.
        model: The filter's model.
    """
    too_large = [] if model is None else overflown(model.sites, state.particles)
    if too_large:
        return f"frame {frame}: {overflow_message(too_large)}"
    advice = ["try a smaller step size"] if hasattr(state, "log_step_size") else []
    if state.particles.dtype == np.float32:
        advice.append("call jax.config.update('jax_enable_x64', True) first")
    return (
        f"frame {frame}: the filter's state is not finite; its model or settings break down there, and nothing after it could "
        f"be trusted ({', '.join(advice)}{', or ' if advice else ''}check the model's densities)"
    )
