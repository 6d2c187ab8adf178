"""Fast motion in one camera: what the default tracker loses, and to what, for docs/validation/motion.md."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from poseppl_papers.measured import over_runs
from poseppl_papers.tables import Table, markdown

from studies.verdicts.walks import STUDENT

Tables = Mapping[str, Table]
Runs = dict[int, Mapping[str, Any]]
"""Runs of a recording and a case by seed."""
LEAST, MOST = 0.85, 0.95
"""Bounds of a goal's coverage."""
QUESTIONS = {
    "Learned scales less published ones": ("learned", "fixed"),
    "Mean-reverting angles less published steps": ("mean-reverting", "fixed"),
    "Mean-reverting angles less learned scales": ("mean-reverting", "learned"),
    "A scale of each translation less one for all": ("learned", "learned one translation"),
    "A root with a velocity less one without": ("root velocity", "fixed"),
    "More chains, climbs and Gaussians less the default": ("learned more chains", "learned"),
    "Points that the body can have less recorded ones": ("fixed fitted", "fixed"),
    "The same with learned scales": ("learned fitted", "learned"),
    "The same with mean-reverting angles": ("mean-reverting fitted", "mean-reverting"),
}
ANSWERS = {"learned": "Learned scales", "mean-reverting": "Mean-reverting angles"}
"""Cases that are to halve the errors of published steps."""


class Interval(NamedTuple):
    """A mean over runs and half of its 95 % interval by Student's t."""

    mean: float
    reach: float

    def text(self) -> str:
        """The mean with its interval, in bold where that leaves out 0."""
        mark = "**" if abs(self.mean) > self.reach else ""
        return f"{mark}{self.mean:+.0f} ± {self.reach:.0f}{mark}"


def fast_motion(tables: Tables) -> str:
    """Errors and coverage by case, what differs between cases, and whether errors were halved."""
    groups: dict[str, dict[str, Runs]] = {}
    for row in tables["fast_motion"].records():
        groups.setdefault(row["recording"], {}).setdefault(row["case"], {})[row["seed"]] = row
    cases = list(dict.fromkeys(case for runs in groups.values() for case in runs))
    errors = markdown(("", *groups), [[case, *(_cell(runs.get(case, {})) for runs in groups.values())] for case in cases])
    asked = [
        [question, *(difference(runs, one, other).text() for runs in groups.values())]
        for question, (one, other) in QUESTIONS.items()
        if all({one, other} <= set(runs) for runs in groups.values())
    ]
    goals = [_goals(groups, case, name) for case, name in ANSWERS.items() if all(case in runs for runs in groups.values())]
    return f"{errors}\n\n{markdown(('mm', *groups), asked)}\n\n" + "\n".join(goals)


def fast_motion_modes(tables: Tables) -> str:
    """Log-masses of the modes from the truth less those from the filter, by recording, and their errors."""
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for row in tables["fast_motion_modes"].records():
        groups.setdefault(row["recording"], []).append(row)
    shown = [
        [
            name,
            ", ".join(f"{row['mass']:+.0f}" for row in rows),
            *(", ".join(f"{row[start]:.0f}" for row in rows) for start in ("from_truth", "from_filter")),
        ]
        for name, rows in groups.items()
    ]
    less = sum(row["mass"] < 0 for rows in groups.values() for row in rows)
    header = ("", "log-mass, truth's less the filter's", "error of the truth's mode, mm", "error of the filter's, mm")
    text = f"The mode from the truth has the smaller mass in {less} of {sum(map(len, groups.values()))} runs."
    return f"{markdown(header, shown)}\n\n{text}"


def difference(runs: Mapping[str, Runs], one: str, other: str, share: float = 1.0) -> Interval:
    """Error of one case less a share of another's, paired by the noise that both saw."""
    seen = sorted(set(runs[one]) & set(runs[other]))
    paired = over_runs([runs[one][seed]["error"] - share * runs[other][seed]["error"] for seed in seen])
    return Interval(paired.mean, STUDENT[paired.runs - 1] * paired.error if paired.runs > 1 else float("inf"))


def _cell(runs: Runs) -> str:
    if not runs:
        return ""
    error, coverage = (over_runs([row[name] for row in runs.values()]).mean for name in ("error", "coverage"))
    return f"{error:.0f}, {100 * coverage:.0f} %"


def _goals(groups: Mapping[str, Mapping[str, Runs]], case: str, name: str) -> str:
    """Whether a case halves the errors, and has the right coverage."""
    halved = {name: difference(runs, case, "fixed", 0.5) for name, runs in groups.items()}
    means = {name: over_runs([row["coverage"] for row in runs[case].values()]).mean for name, runs in groups.items()}
    inside = {name: LEAST <= mean <= MOST for name, mean in means.items()}
    sure = [name for name, less in halved.items() if less.mean + less.reach < 0]
    lost = [name for name, less in halved.items() if less.mean > less.reach]
    likely = [name for name, less in halved.items() if less.mean <= 0]
    return (
        f"- {name} halve the errors: {_verdict(len(sure), len(lost), len(halved))}; by 95 % intervals they do on "
        f"{_list(sure)} and do not on {_list(lost)}; by means on {_list(likely)}.\n"
        f"- The coverage of their 90 % intervals is {100 * LEAST:.0f} to {100 * MOST:.0f} %: "
        f"{'holds' if all(inside.values()) else 'does not hold'}; on {_list([name for name in inside if inside[name]])}."
    )


def _verdict(sure: int, lost: int, count: int) -> str:
    return "does not hold" if lost else "holds" if sure == count else "undecided"


def _list(names: list[str]) -> str:
    return f"{len(names)} ({', '.join(names)})" if names else "none"
