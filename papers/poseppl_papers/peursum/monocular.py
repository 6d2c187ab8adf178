"""Section 7.2, Table 3: filters and smoothers before the animated body, seen by one camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl_papers.experiment import Claim, Jobs, Results, Tables
from poseppl_papers.measured import Interval, mean_interval
from poseppl_papers.peursum.animated import AnimatedScene, animated_problem
from poseppl_papers.peursum.posture import posture_squares
from poseppl_papers.peursum.smoothed_walks import ALGORITHMS, SmoothedRuns, motion_of, smooth_track
from poseppl_papers.peursum.tracks import run_track
from poseppl_papers.runs import stacked
from poseppl_papers.tables import Table, markdown

BURN_IN_FRAMES = 5
COLUMNS = ("scene", "frames", "filter", "smoother", "run", "relative", "absolute", "ess_share")
FILTER, SMOOTHERS = ALGORITHMS[0], ALGORITHMS[1:]
SHARPER = "lambda"
"""In the names of filters whose likelihood is sharpened as one camera in place of four would have it."""
GENERIC = "Simple-PF"
"""First word of the filter's name whose motion is not learned."""
THEIRS = {GENERIC: (111.1, 112.1, 120.1, 111.7), "FSHHMM-PF": (54.1, 47.6, 57.3, 57.1)}
"""Table 3: relative errors by :data:`ALGORITHMS`, mm."""
_ABOUT = (
    "Root mean squared error of the mean posture over fifteen markers and the frames from the sixth on (mm), with the pelvises "
    "together and as it is; mean share of particles that are effective."
)


@dataclass(frozen=True)
class SmoothedAnimation(SmoothedRuns):
    """Runs before the animated body."""

    scene: AnimatedScene


def smooth_animation(job: SmoothedAnimation) -> dict[str, Any]:
    """Run the filter and the smoothers.

    Returns:
        ``squares`` (run, algorithm, frame, 2), mm^2, by :data:`ALGORITHMS`: mean squared distances of markers from the truth,
        as they are and with the pelvises together; ``ess_share`` (run,).
    """
    system = job.taught
    problem = animated_problem(job.scene, system)
    filter = job.method.build(problem)
    step, motion, rows = jit(filter.step), motion_of(problem, system), []
    for run in job.runs:
        found = smooth_track(problem, run_track(problem, filter, step, run), motion, job.rounds, run, posture_squares)
        rows.append({"squares": found["errors"], "ess_share": np.asarray(found["ess_share"])})
    return stacked(rows)


def monocular_table(jobs: Jobs, results: Results) -> list[Table]:
    """One row a filter, smoother and run."""
    rows: list[tuple[Any, ...]] = []
    for job in jobs["monocular"]:
        found = results[job.key]
        for index, run in enumerate(job.runs):
            for number, name in enumerate(ALGORITHMS):
                absolute, relative = np.sqrt(found["squares"][index, number, BURN_IN_FRAMES:].mean(0)).tolist()
                told = relative, absolute, float(found["ess_share"][index])
                rows.append((job.scene.name, job.scene.num_frames, job.method.name, name, run, *told))
    return [Table("monocular", COLUMNS, rows, _ABOUT)]


def errors(table: Table, filter: str, smoother: str, column: str = "relative") -> Floats:
    """A column of a filter and smoother, in the order of the runs."""
    return table.column(column, filter=filter, smoother=smoother).astype(float)


def monocular(tables: Tables) -> str:
    """Errors of all algorithms beside the published ones, and what smoothers take away of them."""
    if "monocular" not in tables:
        return ""
    table, rows = tables["monocular"], []
    for filter in table.values("filter"):
        theirs = _published(filter)
        for name, published in zip(ALGORITHMS, theirs, strict=True):
            own, whole = (errors(table, filter, name, column) for column in ("relative", "absolute"))
            less = "" if name == FILTER else _told(errors(table, filter, FILTER) - own)
            share = f"{errors(table, filter, name, 'ess_share').mean():.2g}"
            rows.append([filter, name, f"{published:g}", _told(own), less, _told(whole), share, str(len(own))])
    columns = ("filter", "smoother", "published, relative", "relative", "less", "absolute", "ESS / N", "runs")
    return markdown(columns, rows)


def monocular_claims(tables: Tables) -> list[Claim]:
    """What section 7.2 says of the two filters and of each smoother."""
    table, found = tables["monocular"], []
    for filter in table.values("filter"):
        before, (published, *smoothed) = errors(table, filter, FILTER), _published(filter)
        told, verdicts = [], []
        for name, value in zip(SMOOTHERS, smoothed, strict=True):
            gain = mean_interval(before - errors(table, filter, name))
            told.append(f"{name} {gain.told('.1f')}")
            verdicts.append(f"{name} {gain.above(0) if value < published else gain.below(0)}")
        theirs = ", ".join(f"{name} {published - value:.1f}" for name, value in zip(SMOOTHERS, smoothed, strict=True))
        what = f"Table 3: which smoothers lower the relative error of {filter} from one camera"
        found.append(Claim(what, f"mm less: {theirs}", f"mm less: {', '.join(told)}", "; ".join(verdicts), _WHY))
    generic = [filter for filter in table.values("filter") if filter.startswith(GENERIC)]
    learned = [filter for filter in table.values("filter") if not filter.startswith(GENERIC)]
    pairs = [(own, other) for other in generic for own in learned if (SHARPER in own) == (SHARPER in other)]
    return found + [_halved(table, own, other) for own, other in pairs]


def _halved(table: Table, filter: str, generic: str) -> Claim:
    own, other = (errors(table, name, FILTER) for name in (filter, generic))
    less, reach = 0.5 * other.mean() - own.mean(), np.hypot(0.5 * _reach(other), _reach(own))
    what = f"Table 3: from one camera the relative error of {filter} is half of that of {generic}"
    published = "" if generic.startswith(f"{GENERIC}, 10,000") else "; the paper's Simple-PF has 10,000 particles"
    why = f"at most half, by 95 % intervals over runs, squares added{published}"
    return Claim(
        what, "54.1 mm against 111.1", f"{_told(own)} mm against {_told(other)}", Interval.around(less, reach).above(0), why
    )


_WHY = "the sign of what a smoother takes away, by 95 % intervals over runs"


def _published(filter: str) -> tuple[float, ...]:
    return next(errors for word, errors in THEIRS.items() if filter.startswith(word))


def _told(values: Floats) -> str:
    return mean_interval(values).told(".1f")


def _reach(values: Floats) -> float:
    found = mean_interval(values)
    return found.high - found.mean
