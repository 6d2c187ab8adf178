"""How far a set of jobs is: how many are done, and how long the rest will take.

The time left is the time so far times the cost of what is left over the cost of what was done: an estimate as good as the
relative costs that the jobs tell. What earlier calls did counts as done, but not as work of this one.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, SpinnerColumn, Task, TextColumn
from rich.progress import TimeElapsedColumn as TimeElapsedColumn
from rich.text import Text


class JobProgress(Protocol):
    """Who is told how jobs go."""

    def started(self, total: int, done: int, cost: float) -> None:
        """There are so many jobs, so many of them done before; the others cost so much."""

    def finished(self, cost: float) -> None:
        """One more job is done or has failed; it cost so much."""

    def note(self, message: str) -> None:
        """Something that the user should know."""


class Silent:
    """Tells nobody."""

    def started(self, total: int, done: int, cost: float) -> None:
        """See :class:`JobProgress`."""

    def finished(self, cost: float) -> None:
        """See :class:`JobProgress`."""

    def note(self, message: str) -> None:
        """See :class:`JobProgress`."""


class Clock:
    """Estimates the time left.

    Args:
        cost: Of all that is to be done.
        now: The time, in seconds.
    """

    def __init__(self, cost: float, now: float) -> None:
        self._start = now
        self._left = cost
        self._done = 0.0
        self._estimate: float | None = None
        self._at = now

    def finished(self, cost: float, now: float) -> None:
        """A job of this cost was finished at this time."""
        self._done += cost
        self._left = max(0.0, self._left - cost)
        self._estimate = (now - self._start) * self._left / self._done
        self._at = now

    def seconds_left(self, now: float) -> float | None:
        """Seconds left; None before the first job is done."""
        if self._estimate is None:
            return None
        return max(0.0, self._estimate - (now - self._at))


class _TimeLeft(ProgressColumn):
    def render(self, task: Task) -> Text:
        clock = task.fields.get("clock")
        seconds = None if clock is None else clock.seconds_left(time.monotonic())
        return Text(f"{shown_time(seconds)} left")


def shown_time(seconds: float | None) -> str:
    """Seconds as 1:02:03 or 2:03; dashes where they are not known."""
    if seconds is None:
        return "-:--"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


class JobBar:
    """A bar on stderr with jobs done, time so far and time left; off where stderr is no terminal, or when asked to be quiet.

    Args:
        description: What is being done.
        quiet: Whether to show no bar; notes are always written.
    """

    def __init__(self, description: str = "jobs", quiet: bool = False) -> None:
        self.description = description
        self.console = Console(stderr=True, soft_wrap=True, highlight=False)
        self._bar = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("jobs"),
            TimeElapsedColumn(),
            _TimeLeft(),
            console=self.console,
            transient=True,
            disable=quiet or not self.console.is_terminal,
        )
        self._task = self._bar.add_task(description, total=None)
        self._clock = Clock(0.0, time.monotonic())

    @contextmanager
    def running(self) -> Iterator[JobBar]:
        """Show the bar inside of a block."""
        with self._bar:
            yield self

    def started(self, total: int, done: int, cost: float) -> None:
        """See :class:`JobProgress`."""
        self._clock = Clock(cost, time.monotonic())
        self._bar.reset(self._task, description=self.description, total=total, completed=done, clock=self._clock)

    def finished(self, cost: float) -> None:
        """See :class:`JobProgress`."""
        self._clock.finished(cost, time.monotonic())
        self._bar.advance(self._task)

    def note(self, message: str) -> None:
        """Tell of something, above the bar."""
        self.console.print(f"poseppl: {message}", markup=False)
