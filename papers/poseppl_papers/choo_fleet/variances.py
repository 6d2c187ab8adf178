"""From the estimates of section 7.3 to its figures: estimator variances, their speed-up, and volumes of prior and posterior.

The variance of an estimate is Eq. 3, its mean squared distance from the posterior's mean, so it includes the bias. The
reference's own error is subtracted, which keeps it unbiased. Its unit is the posterior's variance: it is one over the number of
independent draws that the estimate is worth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from poseppl.arrays import Floats
from poseppl_papers.choo_fleet.single_frame import METHODS, FrameRuns
from poseppl_papers.experiment import Results
from poseppl_papers.runs import joined
from poseppl_papers.tables import grouped

_RESAMPLES = 400
_MIN = 1e-12


class FrameErrors(NamedTuple):
    """Errors of the estimates at one frame, over all runs.

    Attributes:
        recording: Recording of the person that is seen.
        frame: Index of the frame.
        squared: For each method (run, setting, d): squared distance from the reference over the posterior's variance, less the
            reference's own.
        reference: The reference's own squared standard error over the posterior's variance, (run, d).
        log_bounds: log10 of the lower bounds on the number of particles (run,), by name.
    """

    recording: str
    frame: int
    squared: Mapping[str, Floats]
    reference: Floats
    log_bounds: Mapping[str, Floats]


def frame_errors(jobs: Sequence[FrameRuns], results: Results, system: str) -> list[FrameErrors]:
    """Put the blocks of runs of each recording and frame together."""
    own = [job for job in jobs if job.system == system]
    return [_errors(group, results) for group in grouped(own, lambda job: (job.recording.name, job.frame)).values()]


def _errors(jobs: Sequence[FrameRuns], results: Results) -> FrameErrors:
    whole, first = joined(jobs, results), jobs[0]
    variance = np.diagonal(whole["reference_covariance"], axis1=1, axis2=2)
    own = whole["reference_standard_error"] ** 2 / variance
    squared = {}
    for method in METHODS:
        offset = whole[f"{method}_means"] - whole["reference_mean"][:, None]
        squared[method] = offset**2 / variance[:, None] - own[:, None]
    prior = np.log(np.asarray(results[first.key]["prior_sd"], float)).sum()
    _, log_det = np.linalg.slogdet(whole["reference_covariance"])
    bounds = {
        "marginal": (prior - 0.5 * np.log(variance).sum(-1)) / np.log(10),
        "determinant": (prior - 0.5 * log_det) / np.log(10),
    }
    return FrameErrors(first.recording.name, first.frame, squared, own, bounds)


def geometric_variance(squared: Floats) -> Floats:
    """Geometric mean over coordinates of the variance, (setting,), from (run, setting, d)."""
    return np.asarray(np.exp(np.log(np.maximum(squared.mean(0), _MIN)).mean(-1)))


def log_standard_error(squared: Floats) -> Floats:
    """Standard error of the log of the geometric mean variance, by the jackknife over runs."""
    runs = len(squared)
    left_out = np.log([geometric_variance(np.delete(squared, run, axis=0)) for run in range(runs)])
    return np.asarray(np.sqrt((runs - 1) / runs * np.square(left_out - left_out.mean(0)).sum(0)))


class SpeedUp(NamedTuple):
    """How many times faster HMC is than the particle filter at equal variance, with a 90 % interval by the bootstrap.

    Attributes:
        ratio: Above 1 where HMC is faster.
        low: 5 % quantile.
        high: 95 % quantile.
        extrapolated: Share of HMC's settings whose variance no number of particles reached; there the particle filter is taken
            to gain as 1/N from its last setting on, as the paper does, which flatters it.
    """

    ratio: float
    low: float
    high: float
    extrapolated: float


def speed_up(errors: Sequence[FrameErrors], cost: Mapping[str, Floats]) -> SpeedUp:
    """Compare the methods at equal variance.

    Args:
        errors: The frames of one tracker; their variances are averaged geometrically.
        cost: Seconds or evaluations of each method (repeat, setting), of which the medians count. The methods took turns:
            a repetition of one is drawn together with that of the other.
    """
    rng = np.random.default_rng(0)
    repeats = len(cost[METHODS[0]])
    ratio, outside = _ratio({method: _curve(errors, method, None) for method in METHODS}, _medians(cost, np.arange(repeats)))
    ratios = []
    for _ in range(_RESAMPLES):
        chosen = [rng.integers(0, len(each.reference), len(each.reference)) for each in errors]
        spent = _medians(cost, rng.integers(0, repeats, repeats))
        ratios.append(_ratio({method: _curve(errors, method, chosen) for method in METHODS}, spent)[0])
    low, high = np.quantile(ratios, [0.05, 0.95])
    return SpeedUp(ratio, float(low), float(high), outside)


def _medians(cost: Mapping[str, Floats], repeats: Any) -> dict[str, Floats]:
    """Medians over some repetitions (setting,)."""
    return {method: np.median(values[repeats], axis=0) for method, values in cost.items()}


def _curve(errors: Sequence[FrameErrors], method: str, chosen: Sequence[Any] | None) -> Floats:
    """Variance (setting,) over frames."""
    parts = [each.squared[method] if chosen is None else each.squared[method][chosen[i]] for i, each in enumerate(errors)]
    return np.asarray(np.exp(np.mean([np.log(geometric_variance(part)) for part in parts], axis=0)))


def _ratio(variance: Mapping[str, Floats], cost: Mapping[str, Floats]) -> tuple[float, float]:
    """Geometric mean over HMC's settings of the particle filter's cost at HMC's variance, over HMC's cost."""
    particle = np.minimum.accumulate(variance["particle"])
    logs, outside = [], 0
    for value, spent in zip(variance["hmc"], cost["hmc"], strict=True):
        if value >= particle[0]:
            needed = cost["particle"][0] * particle[0] / value
        elif value <= particle[-1]:
            needed = cost["particle"][-1] * particle[-1] / value
            outside += value < particle[-1]
        else:
            order = np.argsort(particle)
            needed = np.exp(np.interp(np.log(value), np.log(particle[order]), np.log(cost["particle"][order])))
        logs.append(np.log(needed / spent))
    return float(np.exp(np.mean(logs))), outside / len(logs)
