"""The job: runs of a filter whose motion, walk or limits were learned from recordings, separately for each run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from poseppl.motion.learned import read_motion_model
from poseppl_papers.darby.people import Training, trained_file
from poseppl_papers.images.systems import problem_of
from poseppl_papers.images.tracking import Tracking, compiled_step, first_state, run_once
from poseppl_papers.runs import stacked


@dataclass(frozen=True)
class Taught(Tracking):
    """Runs of one filter, each with a newly trained model.

    Attributes:
        training: Training data; seeds of training are those of the runs.
    """

    training: Training | None = None


def track_taught(job: Taught) -> dict[str, Any]:
    """Run the filter; what is returned is as that of :func:`poseppl_papers.images.tracking.track`."""
    assert job.training is not None
    files = [trained_file(job.training, run) for run in job.runs]
    system = job.system.with_settings(model=files[0], subject=job.training.subject or None)
    problem = problem_of(job.scene, system, job.num_frames)
    filter, step = compiled_step(job.scene, system, job.num_frames, job.method)
    learned, rows = problem.system.learned, []
    assert learned is not None and learned.taught is not None
    for run, file in zip(job.runs, files, strict=True):
        model = read_motion_model(file)
        taught = problem._replace(frames=[learned.taught(inputs, model) for inputs in problem.frames])
        rows.append(run_once(taught, step, first_state(taught, filter, run), run, job.weighs))
    return stacked(rows)
