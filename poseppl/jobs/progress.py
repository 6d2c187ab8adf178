"""Progress of a set of jobs."""

from __future__ import annotations

from typing import Protocol


class JobProgress(Protocol):
    """Receives the progress of jobs."""

    def started(self, total: int, done: int, cost: float) -> None:
        """There are so many jobs, so many of them done before; the others cost so much."""

    def finished(self, cost: float) -> None:
        """One more job is done or has failed; it cost so much."""

    def note(self, message: str) -> None:
        """Something that the user should know."""


class Silent:
    """Reports nothing."""

    def started(self, total: int, done: int, cost: float) -> None:
        """See :class:`JobProgress`."""

    def finished(self, cost: float) -> None:
        """See :class:`JobProgress`."""

    def note(self, message: str) -> None:
        """See :class:`JobProgress`."""
