"""Fixed and learned places of markers on the body, with fixed and learned walks, for docs/validation/motion.md."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from statistics import median
from typing import Any

from poseppl_papers.measured import over_runs
from poseppl_papers.tables import Table, markdown

from studies.verdicts.walks import listed, paired_difference

Tables = Mapping[str, Table]
Runs = dict[tuple[str, str], dict[int, Mapping[str, Any]]]
"""Runs of a recording by walk and places, and by seed."""
CASES = tuple(product(("fixed", "learned"), ("fixed", "learned")))
_HOLD = (0.85, 0.95)


def marker_places(tables: Tables) -> str:
    """Errors and coverage by recording, and what learned places win."""
    groups: dict[tuple[str, float, int, int], Runs] = {}
    for row in tables["marker_places"].records():
        key = (row["recording"], row["rate"], row["cameras"], row["frames"])
        groups.setdefault(key, {}).setdefault((row["walk"], row["markers"]), {})[row["seed"]] = row
    columns = ["recording", "Hz", "cameras", "frames", "runs", *(f"{walk} walk, {places} positions" for walk, places in CASES)]
    columns += ["s a run, all learned", "s of learning"]
    shown = [[key[0], f"{key[1]:g}", *map(str, key[2:]), *_cells(runs)] for key, runs in groups.items()]
    lines = [_told(walk, count, groups) for count, walk in product(sorted({key[2] for key in groups}), ("fixed", "learned"))]
    return "\n\n".join([markdown(columns, shown), "\n".join(lines)])


def _cells(runs: Runs) -> list[str]:
    cells = [f"{_mean(runs, case, 'error'):.1f}, {100 * _mean(runs, case, 'coverage'):.0f} %" for case in CASES]
    last = runs[CASES[-1]].values()
    seconds = [f"{median(row[name] for row in last):.2g}" for name in ("seconds", "learning")]
    return [str(max(map(len, runs.values()))), *cells, *seconds]


def _mean(runs: Runs, case: tuple[str, str], name: str) -> float:
    return over_runs([row[name] for row in runs[case].values()]).mean


def _told(walk: str, count: int, groups: Mapping[tuple[str, float, int, int], Runs]) -> str:
    """Method with the smaller error for this number of cameras and this walk, and methods with the right coverage."""
    recordings = {key[0]: runs for key, runs in groups.items() if key[2] == count}
    less = {name: paired_difference(runs[walk, "learned"], runs[walk, "fixed"]) for name, runs in recordings.items()}
    sure = [[name for name, found in less.items() if found.verdict == verdict] for verdict in ("wins", "loses")]
    means = [sum(_mean(runs, (walk, places), "error") for runs in recordings.values()) for places in ("fixed", "learned")]
    hold = [
        sum(_HOLD[0] <= _mean(runs, (walk, places), "coverage") <= _HOLD[1] for runs in recordings.values())
        for places in ("fixed", "learned")
    ]
    share, wins, loses = 100 * (1 - means[1] / means[0]), len(sure[0]), listed(sure[1])
    return (
        f"- {count} cameras, {walk} walk: learned positions reduce the mean error by {share:.0f} %; by 95 % intervals they win "
        f"on {wins} of {len(less)} recordings and lose on {loses}. The coverage of 90 % intervals is 85 to 95 % on {hold[1]} "
        f"with them, on {hold[0]} without."
    )
