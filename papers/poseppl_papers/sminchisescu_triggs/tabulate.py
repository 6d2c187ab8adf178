"""Tables: each run, and each tracker on each scene."""

from __future__ import annotations

from typing import Any

import numpy as np

from poseppl_papers.experiment import Jobs, Results
from poseppl_papers.measured import mean_interval
from poseppl_papers.sminchisescu_triggs.survival import kept_seconds, percent_lost
from poseppl_papers.tables import Table

COLUMNS = ("scene", "motion", "rate", "room", "length", "tracker", "seed", "lost", "error", "ratio", "modes", "seconds")
_ABOUT = (
    "Seconds after which the body was lost (inf: never), mean error (mm) of markers relative to the root until then, "
    "largest over smallest standard deviation of the heaviest mode (metres, radians), modes, processor seconds a frame."
)


def runs_table(name: str, jobs: Jobs, results: Results) -> list[Table]:
    """Every run of a part."""
    rows = []
    for job in [job for own in jobs.values() for job in own]:
        found, room = results[job.key], "cluttered" if job.cluttered else "black"
        for index, seed in enumerate(job.seeds):
            values = [float(found[key][index]) for key in ("lost", "error", "ratio", "modes", "seconds")]
            rows.append((name, job.motion, job.rate, room, job.seconds, job.tracker, seed, *values))
    return [Table(name, COLUMNS, rows, _ABOUT)]


def losses(table: Table) -> list[tuple[Any, ...]]:
    """Of each tracker at each rate in each room: runs, share lost and seconds kept with 95 % intervals, error (mm), ratio."""
    rows = []
    for room in table.values("room"):
        for rate in table.values("rate", room=room):
            for tracker in table.values("tracker", room=room, rate=rate):
                lost, error, length, ratio = (
                    table.column(name, room=room, rate=rate, tracker=tracker) for name in ("lost", "error", "length", "ratio")
                )
                kept = mean_interval(kept_seconds(lost, length)).clipped(0, length[0])
                rows.append(
                    (
                        f"{rate:g}",
                        room,
                        tracker,
                        len(lost),
                        percent_lost(lost).told(unit=" %"),
                        kept.told(".2f", f" of {length[0]:.3g} s"),
                        f"{np.nanmean(error):.0f}",
                        f"{np.nanmean(ratio):.0f}" if np.isfinite(ratio).any() else "–",
                    )
                )
    return rows


LOSSES = ("frames a second", "room", "tracker", "runs", "lost", "kept for", "error, mm", "largest / smallest sd")
