"""Tables: each run, and each tracker on each scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from poseppl.experiments.experiment import Results
from poseppl.experiments.measured import mean_interval
from poseppl.experiments.sminchisescu_triggs.images import Pictures
from poseppl.experiments.sminchisescu_triggs.survival import kept_seconds, share_interval
from poseppl.experiments.sminchisescu_triggs.tracks import Tracks
from poseppl.experiments.tables import Table

COLUMNS = ("scene", "motion", "rate", "room", "length", "tracker", "seed", "lost", "error", "ratio", "modes", "seconds")
_ABOUT = (
    "Seconds after which the body was lost (inf: never), mean error (mm) of markers relative to the root until then, "
    "largest over smallest standard deviation of the heaviest mode (metres, radians), modes, processor seconds a frame."
)


def runs_table(name: str, scene: str, jobs: Sequence[Tracks] | Sequence[Pictures], results: Results) -> Table:
    """Every run of a part."""
    rows = []
    for job in jobs:
        found, room = results[job.key], "cluttered" if job.cluttered else "black"
        for index, seed in enumerate(job.seeds):
            values = [float(found[key][index]) for key in ("lost", "error", "ratio", "modes", "seconds")]
            rows.append((scene, job.motion, job.rate, room, job.seconds, job.tracker, seed, *values))
    return Table(name, COLUMNS, rows, _ABOUT)


def losses(table: Table) -> list[tuple[Any, ...]]:
    """Of each tracker at each rate in each room: runs, share lost and seconds kept with 95 % intervals, error (mm), ratio."""
    rows = []
    for room in dict.fromkeys(table.column("room")):
        for rate in dict.fromkeys(table.column("rate", room=room)):
            for tracker in dict.fromkeys(table.column("tracker", room=room, rate=rate)):
                lost, error, length, ratio = (
                    table.column(name, room=room, rate=rate, tracker=tracker) for name in ("lost", "error", "length", "ratio")
                )
                count = int(np.isfinite(lost).sum())
                low, high = share_interval(count, len(lost))
                kept = mean_interval(kept_seconds(lost, length))
                rows.append(
                    (
                        f"{rate:g}",
                        room,
                        tracker,
                        len(lost),
                        f"{100 * count / len(lost):.0f} % ({100 * low:.0f} to {100 * high:.0f})",
                        f"{kept[0]:.2f} of {length[0]:.3g} s ({max(kept[1], 0):.2f} to {min(kept[2], length[0]):.2f})",
                        f"{np.nanmean(error):.0f}",
                        f"{np.nanmean(ratio):.0f}",
                    )
                )
    return rows


LOSSES = ("frames a second", "room", "tracker", "runs", "lost", "kept for", "error, mm", "largest / smallest sd")
