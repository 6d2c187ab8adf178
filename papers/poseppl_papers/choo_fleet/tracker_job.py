"""Common part of all jobs of the reproduction: a tracker, and the person that it sees."""

from __future__ import annotations

from dataclasses import dataclass

from poseppl.jobs import Job
from poseppl_papers.choo_fleet.systems import SYSTEMS, System
from poseppl_papers.recordings import Recording


@dataclass(frozen=True)
class TrackerJob(Job):
    """A job of one tracker.

    Attributes:
        recording: Recording of the person that is seen.
        system: The tracker.
    """

    recording: Recording
    system: str

    @property
    def row(self) -> System:
        """The tracker and its row of Table 1."""
        return SYSTEMS[self.system]
