"""Section 7.2, Table 3: filters and smoothers before the animated body, seen by one camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from poseppl.compilation import jit
from poseppl_papers.experiment import Claim, Jobs, Results, Tables
from poseppl_papers.measured import MATTERS, Interval, mean_interval
from poseppl_papers.peursum.animated import AnimatedScene, animated_problem
from poseppl_papers.peursum.posture import posture_squares
from poseppl_papers.peursum.smoothed_walks import ALGORITHMS, SmoothedRuns, motion_of, smooth_track
from poseppl_papers.peursum.tracks import run_track
from poseppl_papers.runs import stacked
from poseppl_papers.tables import Table, grouped, markdown

BURN_IN_FRAMES = 5
BOUND = 100 * MATTERS
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
                figures = relative, absolute, float(found["ess_share"][index])
                rows.append((job.scene.name, job.scene.num_frames, job.method.name, name, run, *figures))
    return [Table("monocular", COLUMNS, rows, _ABOUT)]


def errors(table: Table, filter: str, smoother: str, column: str = "relative") -> dict[str, float]:
    """A column of a filter and smoother by person, the mean over runs."""
    groups = grouped(table.records(filter=filter, smoother=smoother), lambda row: row["scene"])
    return {scene: float(np.mean([row[column] for row in rows])) for scene, rows in groups.items()}


def monocular(tables: Tables) -> str:
    """Errors of all algorithms beside the published ones, and what smoothers take away of them."""
    if "monocular" not in tables:
        return ""
    table, rows = tables["monocular"], []
    for filter in table.values("filter"):
        theirs = _published(filter)
        for name, published in zip(ALGORITHMS, theirs, strict=True):
            own, whole, ess = (errors(table, filter, name, column) for column in ("relative", "absolute", "ess_share"))
            less = "" if name == FILTER else _gain(table, filter, name).text()
            share, runs = f"{np.mean(list(ess.values())):.2g}", len(table.select(filter=filter, smoother=name))
            rows.append([filter, name, f"{published:g}", _told(own), less, _told(whole), share, str(len(own)), str(runs)])
    columns = ("filter", "smoother", "published, relative", "relative", "less, %", "absolute", "ESS / N", "walks", "runs")
    return markdown(columns, rows)


def monocular_claims(tables: Tables) -> list[Claim]:
    """Claims of section 7.2 about the two filters and each smoother."""
    table, found = tables["monocular"], []
    for filter in table.values("filter"):
        before, *smoothed = _published(filter)
        less = {name: 100 * (1 - value / before) for name, value in zip(SMOOTHERS, smoothed, strict=True)}
        gains = {name: _gain(table, filter, name) for name in SMOOTHERS}
        verdicts = "; ".join(f"{name} {gain.agrees(less[name], BOUND)}" for name, gain in gains.items())
        theirs, ours = (", ".join(f"{name} {value}" for name, value in each) for each in (_shown(less), _intervals(gains)))
        what = f"Table 3: what smoothers take away from the relative error of {filter}, one camera"
        walks = len(errors(table, filter, FILTER))
        ours = f"% less: {ours}; {walks} walk{'s' if walks > 1 else ''}"
        found.append(Claim(what, f"% less: {theirs}", ours, verdicts, _WHY))
    generic = [filter for filter in table.values("filter") if filter.startswith(GENERIC)]
    learned = [filter for filter in table.values("filter") if not filter.startswith(GENERIC)]
    pairs = [(own, other) for other in generic for own in learned if (SHARPER in own) == (SHARPER in other)]
    return found + [_halved(table, own, other) for own, other in pairs]


def _halved(table: Table, filter: str, generic: str) -> Claim:
    own, other = (errors(table, name, FILTER) for name in (filter, generic))
    shares = [100 * own[scene] / other[scene] for scene in other if scene in own]
    share, theirs = mean_interval(shares), [_published(name)[0] for name in (filter, generic)]
    limit = 100 * theirs[0] / theirs[1] + BOUND
    what = f"Table 3: from one camera the relative error of {filter} is half of that of {generic}"
    ours = f"{_told(own)} mm against {_told(other)}; {share.text()} %, {len(shares)} walk{'s' if len(shares) != 1 else ''}"
    published = "" if generic.startswith(f"{GENERIC}, 10,000") else "; the paper's Simple-PF has 10,000 particles"
    why = (
        f"at most {limit:.0f} %, which is theirs and the {BOUND:.0f} % that do not matter; 95 % interval over people{published}"
    )
    return Claim(what, "54.1 mm against 111.1, 49 %", ours, share.below(limit), why)


_WHY = f"more or less by at least {BOUND:.0f} %, or alike, as in the paper; 95 % interval over people"


def _gain(table: Table, filter: str, smoother: str) -> Interval:
    """How much lower the smoother's relative error is, % of its filter's, over people."""
    before, own = (errors(table, filter, name) for name in (FILTER, smoother))
    return mean_interval([100 * (1 - own[scene] / before[scene]) for scene in own])


def _shown(values: Mapping[str, float]) -> list[tuple[str, str]]:
    return [(name, f"{value:.0f}") for name, value in values.items()]


def _intervals(values: Mapping[str, Interval]) -> list[tuple[str, str]]:
    return [(name, value.text()) for name, value in values.items()]


def _published(filter: str) -> tuple[float, ...]:
    return next(errors for word, errors in THEIRS.items() if filter.startswith(word))


def _told(values: Mapping[str, float]) -> str:
    return mean_interval(list(values.values())).text()
