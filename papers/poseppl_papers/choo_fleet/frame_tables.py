"""Tables of section 7.3: variances against time (Figs. 2 and 3), speed-ups, volumes, and how good the references are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from poseppl.arrays import Floats
from poseppl_papers.choo_fleet.single_frame import METHODS, FrameRuns
from poseppl_papers.choo_fleet.systems import SYSTEMS, UPDATES, coordinate_names
from poseppl_papers.choo_fleet.timing import FrameTiming
from poseppl_papers.choo_fleet.variances import (
    FrameErrors,
    frame_errors,
    geometric_variance,
    log_standard_error,
    speed_up,
)
from poseppl_papers.experiment import Results
from poseppl_papers.tables import Table

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
