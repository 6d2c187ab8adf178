"""The default tracker with three random walks on recordings of many rates, for docs/validation/motion.md."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from poseppl_papers.measured import Measured, over_runs
from poseppl_papers.tables import Table, markdown

Tables = Mapping[str, Table]
Runs = dict[str, dict[int, Mapping[str, Any]]]
"""Runs of a recording by walk and seed."""
STUDENT = {1: 12.71, 2: 4.303, 3: 3.182, 4: 2.776, 5: 2.571, 6: 2.447, 7: 2.365, 8: 2.306, 9: 2.262}
"""The 97.5 % points of Student's t by degrees of freedom."""
LEAST = 0.8
_WALKS = {"frame": "15 mm a frame", "second": "square root of time", "learned": "learned"}
_COUNTS = {1: "One camera", 2: "Two cameras"}


class Difference(NamedTuple):
    """An error less another, in mm, over the seeds that both have; half of its 95 % interval."""

    mean: float
    reach: float

    @property
    def verdict(self) -> str:
        """Method with the smaller error, if the interval decides."""
        return "wins" if self.mean + self.reach < 0 else "loses" if self.mean - self.reach > 0 else "undecided"


def random_walks(tables: Tables) -> str:
    """Errors and coverage by recording, and whether learned scales win on all."""
    groups: dict[tuple[str, float, int, int], Runs] = {}
    for row in tables["random_walk"].records():
        key = (row["recording"], row["rate"], row["cameras"], row["frames"])
        groups.setdefault(key, {}).setdefault(row["walk"], {})[row["seed"]] = row
    columns = ("recording", "Hz", "cameras", "frames", "runs", *_WALKS.values(), "learned less square root, mm")
    shown = [[key[0], f"{key[1]:g}", *map(str, key[2:]), *_cells(runs)] for key, runs in groups.items()]
    sentences = [_told(count, {key[0]: runs for key, runs in groups.items() if key[2] == count}) for count in _COUNTS]
    return "\n\n".join([markdown((*columns, "s of learning"), shown), "\n".join([*filter(None, sentences), _goal(groups)])])


def difference(runs: Runs) -> Difference:
    """Learned against the default, paired by the noise that they saw."""
    return paired_difference(runs.get("learned", {}), runs.get("second", {}))


def paired_difference(one: Mapping[int, Mapping[str, Any]], other: Mapping[int, Mapping[str, Any]]) -> Difference:
    """The error of one less that of another, over the seeds that both have."""
    paired = over_runs([one[seed]["error"] - other[seed]["error"] for seed in one if seed in other] or [math.nan])
    return Difference(paired.mean, STUDENT[paired.runs - 1] * paired.error if paired.runs > 1 else math.inf)


def _cells(runs: Runs) -> list[str]:
    less = difference(runs)
    reach = f" ± {less.reach:.0f}" if math.isfinite(less.reach) else ""
    learning = sorted(row["learning"] for row in runs.get("learned", {}).values() if "learning" in row)
    return [
        str(max(map(len, runs.values()))),
        *(_cell(runs.get(walk, {})) for walk in _WALKS),
        "" if math.isnan(less.mean) else f"{less.mean:+.0f}{reach}",
        f"{learning[len(learning) // 2]:.2g}" if learning else "",
    ]


def _cell(runs: Mapping[int, Mapping[str, Any]]) -> str:
    """Error with its standard deviation, and coverage."""
    if not runs:
        return ""
    error, share = (_mean(runs, name) for name in ("error", "coverage"))
    spread = "" if math.isnan(error.spread) else f" ± {error.spread:.0f}"
    return f"{error.mean:.0f}{spread}" + ("" if math.isnan(share.mean) else f", {100 * share.mean:.0f} %")


def _mean(runs: Mapping[int, Mapping[str, Any]], name: str) -> Measured:
    return over_runs([row[name] for row in runs.values()])


def _told(count: int, recordings: Mapping[str, Runs]) -> str:
    """Method with the smaller error for this number of cameras, and methods with narrow intervals."""
    compared = {name: difference(runs) for name, runs in recordings.items() if {"learned", "second"} <= set(runs)}
    if not compared:
        return ""
    smaller = sum(less.mean < 0 for less in compared.values())
    sure = [[name for name, less in compared.items() if less.verdict == verdict] for verdict in ("wins", "loses")]
    narrow = {
        walk: [name for name in compared if _mean(recordings[name][walk], "coverage").mean < LEAST]
        for walk in ("second", "learned")
    }
    return (
        f"- {_COUNTS[count]}: learned scales have the smaller mean error on {smaller} of {len(compared)} recordings; by 95 % "
        f"intervals they win on {len(sure[0])} and lose on {listed(sure[1])}. The coverage is below {100 * LEAST:.0f} % on "
        f"{listed(narrow['learned'])} with learned scales, on {listed(narrow['second'])} without."
    )


def listed(names: Sequence[str]) -> str:
    """How many, and which."""
    return f"{len(names)} ({', '.join(names)})" if names else "none"


def _goal(groups: Mapping[tuple[str, float, int, int], Runs]) -> str:
    """The goal of a default that wins on all."""
    found = {f"{key[0]}, {key[2]}": difference(runs) for key, runs in groups.items() if {"learned", "second"} <= set(runs)}
    larger = [name for name, less in found.items() if less.mean > 0]
    lost = [name for name, less in found.items() if less.verdict == "loses"]
    won = sum(less.verdict == "wins" for less in found.values())
    verdict = "does not hold" if lost or 2 * len(larger) > len(found) else "holds" if won == len(found) else "undecided"
    return (
        f"- Learned scales as the default, if they win on all recordings: {verdict}; they win on {won} of {len(found)} "
        f"(recording, cameras), and their mean error is larger on {listed(larger)}."
    )
