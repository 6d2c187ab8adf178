"""Table of the contest at single frames: error against the reference per second and per evaluation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from poseppl_papers.choo_fleet.contest import ContestRuns
from poseppl_papers.choo_fleet.single_frame import FrameRuns
from poseppl_papers.choo_fleet.variances import geometric_variance, log_standard_error
from poseppl_papers.experiment import Results
from poseppl_papers.tables import Table, grouped


def contest_table(jobs: Sequence[ContestRuns], frames: Sequence[FrameRuns], results: Results) -> Table:
    """One row a method, averaged geometrically over recordings and frames."""
    references = _references(frames, results)
    rows = [_row(method, own, references, results) for method, own in grouped(jobs, lambda job: job.method).items()]
    columns = (
        "method",
        "variance",
        "log_standard_error",
        "bias",
        "seconds",
        "evaluations",
        "effective_draws_per_second",
        "effective_draws_per_evaluation",
    )
    about = (
        "Geometric mean over coordinates, frames and recordings of the mean's squared error, in units of the posterior's "
        "variance; bias is the root mean square over coordinates of the mean error over runs, in standard deviations; one over "
        "the variance is the number of independent draws that an estimate is worth. Seconds are the median over frames and "
        "runs. At one frame, filters that differ only in what they carry to the next one (1 Gaussian or 3, guided or "
        "auxiliary) are the same filter."
    )
    return Table("contest", columns, rows, about)


def _references(frames: Sequence[FrameRuns], results: Results) -> dict[tuple[str, int, int], Mapping[str, Any]]:
    """Reference mean, standard error and posterior variance by recording, frame and run."""
    found: dict[tuple[str, int, int], Mapping[str, Any]] = {}
    for job in frames:
        block = results[job.key]
        for index, run in enumerate(job.runs):
            found[job.recording.name, job.frame, run] = {
                "mean": np.asarray(block["reference_mean"][index], float),
                "error": np.asarray(block["reference_standard_error"][index], float),
                "variance": np.diagonal(np.asarray(block["reference_covariance"][index], float)),
            }
    return found


def _row(method: str, jobs: Sequence[ContestRuns], references: Mapping[Any, Any], results: Results) -> tuple[Any, ...]:
    logs, spreads, biases, seconds, evaluations = [], [], [], [], []
    for job in jobs:
        block = results[job.key]
        known = [references[job.recording.name, job.frame, run] for run in job.runs]
        scaled = np.stack([(block["mean"][i] - each["mean"]) / each["variance"] ** 0.5 for i, each in enumerate(known)])
        own = np.stack([each["error"] ** 2 / each["variance"] for each in known])
        squared = (scaled**2 - own)[:, None]
        logs.append(np.log(geometric_variance(squared)[0]))
        spreads.append(log_standard_error(squared)[0])
        noise = np.mean(scaled.var(0, ddof=1)) / len(scaled)
        biases.append(max(0.0, float(np.mean(scaled.mean(0) ** 2) - noise)))
        seconds.append(np.median(block["seconds"]))
        evaluations.append(np.mean(block["num_likelihood"] + block["num_gradient"]))
    variance = float(np.exp(np.mean(logs)))
    spread = float(np.sqrt(np.square(spreads).sum()) / len(spreads))
    second, evaluation = float(np.median(seconds)), float(np.mean(evaluations))
    per_second, per_evaluation = 1 / (variance * second), 1 / (variance * evaluation)
    return method, variance, spread, float(np.sqrt(np.mean(biases))), second, evaluation, per_second, per_evaluation
