"""The page's statements about a learned prior follow from the runs."""

from __future__ import annotations

import pytest
from poseppl_papers.tables import Table

from studies.verdicts import learned_prior

COLUMNS = ("recording", "case", "seed", "error", "coverage_50", "coverage_90", "probability", "frames_per_second")


def rows_of(coverage: float, probability: float, run: float = 0.1) -> list[tuple[object, ...]]:
    return [
        (name, case, 0, error, 0.5, coverage, chance, 30.0)
        for name, error, chance in (("05_01", 20.0, 0.9), ("07_08", 26.0, probability), ("02_03", 60.0, run))
        for case in ("alone", "mixture", "default")
    ]


def told(coverage: float, probability: float, run: float = 0.1) -> list[str]:
    return learned_prior.points({"learned_prior": Table("", COLUMNS, rows_of(coverage, probability, run))}).splitlines()


def test_goals_are_judged_on_walks_alone() -> None:
    found = told(0.9, 0.8)
    assert found[2] == "| 05_01 | 20, 90 % | 20, 90 % | 20, 90 % | 0.90 |" and found[4].startswith("| 02_03, run | 60")
    # 20 and 26: mean 23, deviation 4.24 over the root of 2, times 12.71
    assert "error 23.0 ± 38.1 mm, below 25: holds" in found[-3] and "90.0 ± 0.0 %, 85 to 95 asked for: holds" in found[-3]
    assert "asked for: does not hold" in told(0.8, 0.8)[-2]


@pytest.mark.full
def test_other_motion_is_noticed_or_mistaken() -> None:
    assert told(0.9, 0.8)[-1].endswith("on 1 of 1 recordings that are no walks, and on 0 of 2 walks.")
    assert told(0.9, 0.3, run=0.7)[-1].endswith("on 0 of 1 recordings that are no walks, and on 1 of 2 walks (07_08).")


@pytest.mark.full
def test_the_overlap_of_silhouettes_reports_other_motion() -> None:
    words = {"05_01": "none", "07_08": "warning", "02_03": "error"}
    rows = [(*row, words[str(row[0])]) for row in rows_of(0.9, 0.8) if row[1] != "default"]
    table = Table("", (*COLUMNS, "overlap"), rows)
    found = learned_prior.silhouettes({"learned_prior_silhouettes": table}).splitlines()
    assert found[4] == "| 02_03, run | 60, 90 % | 60, 90 % | 0.10 | error |" and "below 57: holds" in found[-3]
    assert found[-1].endswith("reports 1 of 1 recordings that are no walks, and 1 of 2 walks.")
