"""Tables of section 7.3: estimator variances against time (Figs. 2 and 3), speed-ups, volumes, and how good the references are.

The variance of an estimate is Eq. 3, its mean squared distance from the posterior's mean, so it includes the bias. The
reference's own error is subtracted, which keeps it unbiased. Its unit is the posterior's variance: it is one over the number of
independent draws that the estimate is worth.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from poseppl.arrays import Floats
from poseppl_papers.choo_fleet.single_frame import METHODS, FrameRuns, FrameTiming
from poseppl_papers.choo_fleet.systems import SYSTEMS, UPDATES, coordinate_names
from poseppl_papers.experiment import Results
from poseppl_papers.runs import joined
from poseppl_papers.tables import Table, grouped

PUBLISHED_SPEED_UP = {"arm": 1 / 8, "lower_body": 50.0, "full_body": 2000.0}
"""HMC over the particle filter at equal variance, Fig. 2."""
PUBLISHED_BOUND = {"arm": 2.0, "lower_body": 5.0, "full_body": 13.0}
"""log10 of the lower bound on the number of particles, section 7.3."""


def frame_tables(frames: Sequence[FrameRuns], timings: Sequence[FrameTiming], results: Results) -> list[Table]:
    """All tables of the single-frame experiment."""
    systems = [name for name in SYSTEMS if any(job.system == name for job in frames)]
    errors = {system: frame_errors(frames, results, system) for system in systems}
    cost = {system: _cost(system, frames, timings, results) for system in systems}
    return [
        _variances(errors, cost),
        _coordinates(errors),
        _speed_ups(errors, cost),
        _volumes(errors),
        _references(errors),
    ]


def _cost(
    system: str, frames: Sequence[FrameRuns], timings: Sequence[FrameTiming], results: Results
) -> Mapping[str, Mapping[str, Floats]]:
    """Seconds of each method (repeat, setting), and evaluations (1, setting); a gradient counts as one evaluation."""
    first = results[next(job.key for job in frames if job.system == system)]
    times = results[next(job.key for job in timings if job.system == system)]
    cost: dict[str, dict[str, Floats]] = {"seconds": {}, "evaluations": {}}
    for method in METHODS:
        cost["seconds"][method] = np.asarray(times[f"{method}_seconds"])
        evaluations = np.asarray(first[f"{method}_num_likelihood"]) + np.asarray(first[f"{method}_num_gradient"])
        cost["evaluations"][method] = evaluations[:1].astype(float)
    return cost


def _sizes(system: str, method: str, num_settings: int) -> list[int]:
    if method == "hmc":
        return list(UPDATES[:num_settings])
    return [SYSTEMS[system].num_particles * 2**setting for setting in range(num_settings)]


def _by_method(errors: Mapping[str, Sequence[FrameErrors]]) -> Iterator[tuple[str, str, FrameErrors, Floats]]:
    """Tracker, method, frame and squared errors (run, setting, d), one after the other."""
    for system, frames in errors.items():
        for each in frames:
            for method, squared in each.squared.items():
                yield system, method, each, squared


def _variances(errors: Mapping[str, Sequence[FrameErrors]], cost: Mapping[str, Any]) -> Table:
    rows = []
    for system, method, each, squared in _by_method(errors):
        spread = log_standard_error(squared)
        for setting, variance in enumerate(geometric_variance(squared)):
            size = _sizes(system, method, squared.shape[1])[setting]
            spent = [float(np.median(cost[system][by][method][:, setting])) for by in ("seconds", "evaluations")]
            rows.append((system, each.recording, each.frame, method, size, *spent, float(variance), float(spread[setting])))
    columns = ("tracker", "recording", "frame", "method", "size", "seconds", "evaluations", "variance", "log_standard_error")
    about = (
        "Geometric mean over coordinates of the estimator's variance, in units of the posterior's; size is N for particles, R "
        "for HMC. The standard error is that of its natural logarithm. Seconds are the median of repetitions in turn."
    )
    return Table("variances", columns, rows, about)


def _coordinates(errors: Mapping[str, Sequence[FrameErrors]]) -> Table:
    """Single variables as Fig. 2 has them: the first recording's middle frame."""
    rows = []
    for system, method, each, squared in _by_method({system: _middle(frames) for system, frames in errors.items()}):
        names = coordinate_names(system)
        for setting, size in enumerate(_sizes(system, method, squared.shape[1])):
            values = squared[:, setting].mean(0)
            spread = squared[:, setting].std(0, ddof=1) / len(squared) ** 0.5
            for coordinate, (value, error) in enumerate(zip(values, spread, strict=True)):
                rows.append((system, each.recording, each.frame, method, size, names[coordinate], float(value), float(error)))
    columns = ("tracker", "recording", "frame", "method", "size", "coordinate", "variance", "standard_error")
    return Table(
        "coordinates", columns, rows, "Estimator variance of single coordinates at one frame, in units of the posterior's."
    )


def _middle(frames: Sequence[FrameErrors]) -> list[FrameErrors]:
    """The middle one of the frames of the first recording."""
    own = [each for each in frames if each.recording == frames[0].recording]
    return [own[len(own) // 2]]


def _speed_ups(errors: Mapping[str, Sequence[FrameErrors]], cost: Mapping[str, Any]) -> Table:
    rows = [
        (system, by, *map(float, speed_up(frames, cost[system][by])), PUBLISHED_SPEED_UP[system])
        for system, frames in errors.items()
        for by in ("seconds", "evaluations")
    ]
    columns = ("tracker", "by", "speed_up", "low", "high", "extrapolated", "published")
    about = (
        "How many times less HMC needs at equal variance, with a 90 % interval over runs and repetitions of the timing; "
        "extrapolated is the share beyond all N."
    )
    return Table("speed_ups", columns, rows, about)


def _volumes(errors: Mapping[str, Sequence[FrameErrors]]) -> Table:
    rows = []
    for system, frames in errors.items():
        for name in ("marginal", "determinant"):
            values = np.array([each.log_bounds[name].mean() for each in frames])
            rows.append((system, name, float(values.mean()), float(values.min()), float(values.max()), PUBLISHED_BOUND[system]))
    columns = ("tracker", "volume", "log10_bound", "lowest", "highest", "published")
    about = (
        "log10 of the least number of particles, the volume of the prior over that of the posterior (Eq. 7): from marginal "
        "variances, as published, and from the covariances' determinants, which see correlations. Mean and range over frames."
    )
    return Table("volumes", columns, rows, about)


def _references(errors: Mapping[str, Sequence[FrameErrors]]) -> Table:
    rows = []
    for system, frames in errors.items():
        for each in frames:
            own = float(np.exp(np.log(np.maximum(each.reference.mean(0), 1e-30)).mean()))
            best = min(float(geometric_variance(squared)[-1]) for squared in each.squared.values())
            rows.append((system, each.recording, each.frame, own, own / best))
    columns = ("tracker", "recording", "frame", "variance", "share_of_smallest")
    return Table(
        "references", columns, rows, "The references' own variance, and its share of the smallest variance in the tables."
    )


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
