"""How far all tasks of a call are: one count of jobs, and the time that is left."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from poseppl.jobs import JobProgress
from poseppl.jobs.run import waiting
from poseppl_papers.experiment import Task


class TotalProgress:
    """Adds up tasks that are run one after the other.

    Costs compare the jobs of one task alone. A job counts as its cost over the mean of its task's; so the time left is that of
    jobs which take as long as those before, whatever their task.

    Args:
        progress: Callback for the progress of all of them.
        tasks: The tasks; those that share a job have it once.
        folder: Folder of the results.
    """

    def __init__(self, progress: JobProgress, tasks: Sequence[Task], folder: Path) -> None:
        self._progress = progress
        jobs = {job.key for task in tasks for job in task.jobs}
        missing: dict[str, float] = {}
        for task in tasks:
            for job in waiting(task.function, task.jobs, folder):
                missing.setdefault(job.key, job.cost / mean_cost(task))
        progress.started(len(jobs), len(jobs) - len(missing), sum(missing.values()))

    def of_task(self, task: Task) -> JobProgress:
        """Callback for one of them."""
        return _Share(self._progress, mean_cost(task))


class _Share:
    """Passes on the progress of one task."""

    def __init__(self, progress: JobProgress, unit: float) -> None:
        self._progress, self._unit = progress, unit

    def started(self, total: int, done: int, cost: float) -> None:
        """Do nothing: all tasks were reported together."""

    def finished(self, cost: float) -> None:
        """One more job is done or has failed."""
        self._progress.finished(cost / self._unit)

    def note(self, message: str) -> None:
        """Something that the user should know."""
        self._progress.note(message)


def mean_cost(task: Task) -> float:
    """Mean cost of a task's jobs; 1 where there are none."""
    return sum(job.cost for job in task.jobs) / len(task.jobs) if task.jobs else 1.0
