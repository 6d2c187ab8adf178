"""Tables: each run, and each tracker on each scene."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from poseppl_papers.experiment import Jobs, Results
from poseppl_papers.measured import mean_interval
from poseppl_papers.sminchisescu_triggs.survival import kept_seconds, percent_lost
from poseppl_papers.tables import Table


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
