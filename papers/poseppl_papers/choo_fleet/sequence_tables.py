"""Tables of section 7.4 (Figs. 4 and 5), and of the contest: errors, coverage and cost of filters over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from poseppl_papers.choo_fleet.sequence import LEVELS, SequenceRuns
from poseppl_papers.experiment import Results
from poseppl_papers.measured import mean_and_error
from poseppl_papers.runs import joined
from poseppl_papers.tables import Table, grouped


def sequence_tables(jobs: Sequence[SequenceRuns], results: Results) -> list[Table]:
    """Tables of Figs. 4 and 5, frame by frame, and their summary."""
    rows = []
    for (tracker, _, method), whole in _grouped(jobs, results).items():
        for frame in range(whole["error"].shape[1]):
            values = [mean_and_error(whole[name][:, frame]) for name in ("log_likelihood", "log_prior", "error")]
            rows.append((tracker, method, frame, *(number for pair in values for number in pair)))
    names = ("log_likelihood", "log_prior", "error")
    columns = ("tracker", "method", "frame", *(column for name in names for column in (name, f"{name}_standard_error")))
    about = "Log-likelihood of the mean state, log prior of the true state, and markers' error (mm): means over runs."
    return [Table("sequence", columns, rows, about), performance("sequence_summary", jobs, results)]


def performance(name: str, jobs: Sequence[SequenceRuns], results: Results) -> Table:
    """Error, coverage, spread and cost of each filter on each recording, over all frames and runs."""
    rows = []
    for (tracker, recording, method), whole in _grouped(jobs, results).items():
        error, relative = (mean_and_error(whole[key].mean(1)) for key in ("error", "error_relative"))
        cover = [mean_and_error(whole["inside_markers"][:, index].mean(1)) for index in range(len(LEVELS))]
        state = [mean_and_error(whole["inside_state"][:, index].mean(1))[0] for index in range(len(LEVELS))]
        spread = float(np.sqrt(np.mean(np.var(whole["markers"], axis=0, ddof=1)) * 3)) if len(whole["markers"]) > 1 else np.nan
        frames = whole["error"].shape[1]
        evaluations = float((whole["num_likelihood"] + whole["num_gradient"]).mean())
        rate = frames / float(np.median(whole["seconds"]))
        covered = [number for pair in cover for number in pair]
        rows.append((tracker, recording, method, *error, relative[0], *covered, *state, spread, rate, evaluations))
    columns = (
        "tracker",
        "recording",
        "method",
        "error",
        "error_standard_error",
        "error_relative",
        "markers_in_50",
        "markers_in_50_standard_error",
        "markers_in_90",
        "markers_in_90_standard_error",
        "state_in_50",
        "state_in_90",
        "spread",
        "frames_per_second",
        "evaluations_per_frame",
    )
    about = (
        "Mean distance of the markers from the truth (mm) and relative to the pelvis, share of true coordinates inside central "
        "intervals, root mean square distance (mm) of a run's means from those of all runs, and cost."
    )
    return Table(name, columns, rows, about)


def _grouped(jobs: Sequence[SequenceRuns], results: Results) -> dict[tuple[str, str, str], Mapping[str, Any]]:
    groups = grouped(jobs, lambda job: (job.system, job.recording.name, job.method))
    return {key: joined(own, results) for key, own in groups.items()}
