"""When a body is lost, and tables of it: shares with Wilson's intervals, mean times until loss with Student's."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from scipy import stats

from poseppl.arrays import Floats
from poseppl_papers.experiment import Jobs, Results
from poseppl_papers.measured import Interval, mean_interval
from poseppl_papers.tables import Table, grouped

LOST = 150.0
"""Mean distance (mm) of markers from the truth, both relative to the root, beyond which a body is lost."""
LASTING = 0.2
"""How long (s) it has to stay so."""


def lost_at(errors: Floats, rate: float) -> float:
    """Second at which a body is lost: errors (T,), mm, stay above :data:`LOST` from there for :data:`LASTING`; inf if never."""
    frames = max(1, round(LASTING * rate))
    above = np.concatenate([[0], np.cumsum(np.asarray(errors) > LOST)])
    full = np.flatnonzero(above[frames:] - above[:-frames] == frames) if len(errors) >= frames else np.array([], int)
    return float(full[0] / rate) if len(full) else float("inf")


def percent_lost(lost: Floats, motions: Iterable[str] = ()) -> Interval:
    """Percent of the runs that lost the body, with its 95 % interval.

    Args:
        lost: Seconds (R,) when they did, inf for never.
        motions: Motion of each run. The interval is Student's over motions if some have several runs, otherwise Wilson's over
            runs.
    """
    groups = grouped(zip(motions, np.isfinite(lost), strict=False), lambda pair: pair[0])
    if 1 < len(groups) < len(lost):
        return mean_interval([100 * float(np.mean([each for _, each in own])) for own in groups.values()]).clipped(0, 100)
    count, runs = int(np.isfinite(lost).sum()), len(lost)
    found: Any = stats.binomtest(count, runs).proportion_ci(method="wilson")
    return Interval(100 * count / runs, 100 * float(found.low), 100 * float(found.high))


def kept_seconds(lost: Floats, seconds: Floats | float) -> Floats:
    """How long a body was kept, s; all of the scene where it was never lost."""
    kept: Floats = np.minimum(np.asarray(lost, float), seconds)
    return kept


def _tracker(job: Any) -> str:
    name: str = job.tracker
    return name


COLUMNS = ("scene", "motion", "rate", "room", "length", "tracker", "seed", "lost", "error", "ratio", "modes", "seconds")
_ABOUT = (
    "Seconds after which the body was lost (inf: never), mean error (mm) of markers relative to the root until then, "
    "largest over smallest standard deviation of the heaviest mode (metres, radians), modes, processor seconds a frame."
)


def runs_table(name: str, jobs: Jobs, results: Results, label: Callable[[Any], str] = _tracker) -> list[Table]:
    """Every run of a part, its tracker called by the label of its job."""
    rows = []
    for job in [job for own in jobs.values() for job in own]:
        found, room = results[job.key], "cluttered" if job.cluttered else "black"
        for index, seed in enumerate(job.seeds):
            values = [float(found[key][index]) for key in ("lost", "error", "ratio", "modes", "seconds")]
            rows.append((name, job.motion, job.rate, room, job.seconds, label(job), seed, *values))
    return [Table(name, COLUMNS, rows, _ABOUT)]


def losses(table: Table) -> list[tuple[Any, ...]]:
    """Rows by tracker, rate and room: runs, share lost and seconds kept with 95 % intervals, error (mm), ratio."""
    rows = []
    for room in table.values("room"):
        for rate in table.values("rate", room=room):
            for tracker in table.values("tracker", room=room, rate=rate):
                names = ("lost", "error", "length", "ratio", "modes")
                lost, error, length, ratio, modes = (
                    table.column(name, room=room, rate=rate, tracker=tracker) for name in names
                )
                motions = table.column("motion", room=room, rate=rate, tracker=tracker)
                kept = mean_interval(kept_seconds(lost, length)).clipped(0, length[0])
                rows.append(
                    (
                        f"{rate:g}",
                        room,
                        tracker,
                        len(lost),
                        percent_lost(lost, motions).text(unit=" %"),
                        kept.text(".2f", f" of {length[0]:.3g} s"),
                        f"{np.nanmean(error):.0f}",
                        f"{np.nanmean(ratio):.0f}" if np.isfinite(ratio).any() else "–",
                        f"{np.nanmean(modes):.1f}" if np.isfinite(modes).any() else "–",
                    )
                )
    return rows


LOSSES = (
    "frames a second",
    "room",
    "tracker",
    "runs",
    "lost",
    "kept for",
    "error, mm",
    "largest / smallest sd",
    "modes a frame",
)
