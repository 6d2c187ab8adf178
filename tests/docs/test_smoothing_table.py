"""The page's statements about smoothing follow from the runs."""

from __future__ import annotations

import pytest
from poseppl_papers.tables import Table

from studies.verdicts.smoothing import smoothing_pays

COLUMNS = ("walk", "seen", "cameras", "seed", "method", "error", "coverage_50", "coverage_90", "seconds")


def told(smoothed: list[float]) -> list[str]:
    rows = []
    for seed, error in enumerate(smoothed):
        key = ("a", "points", "2", seed)
        rows += [(*key, "filter", 100.0, 0.5, 0.9, 0.1), (*key, "window", error, 0.45, 0.88, 1.0)]
    return smoothing_pays({"smoothing_pays": Table("", COLUMNS, rows)}).splitlines()


def test_a_gain_has_an_interval() -> None:
    found = told([80.0, 82.0, 78.0])
    # 20, 18 and 22 %: deviation 2 over the root of 3, times 4.30
    assert found[3] == "| points | 2 | window | 80 | 20 (15 to 25) | 45 | 88 | 1 |"
    assert found[-1] == "- Points, 2 cameras, 3 runs: smoothing pays: holds: window by 20 % (15 to 25)."


@pytest.mark.full
def test_no_gain_is_said_so() -> None:
    assert told([80.0, 130.0, 100.0])[-1].endswith("undecided: window by -3 % (-66 to 59).")
    assert told([128.0, 132.0, 130.0])[-1].endswith("does not hold: window by -30 % (-35 to -25).")


@pytest.mark.full
def test_the_same_silhouettes_count_once() -> None:
    """Two seeds of each of three walks, whose smoothed errors do not depend on the seed."""
    rows = []
    for walk, error in (("a", 80.0), ("b", 82.0), ("c", 78.0)):
        for seed in range(2):
            key = (walk, "silhouettes", "2", seed)
            rows += [(*key, "filter", 100.0, 0.5, 0.9, 0.1), (*key, "window", error, 0.45, 0.88, 1.0)]
    found = smoothing_pays({"smoothing_pays": Table("", COLUMNS, rows)})
    assert found.endswith("6 runs: smoothing pays: holds: window by 20 % (15 to 25).")
