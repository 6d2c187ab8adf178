"""The pages' statements about predictive checks and random walks follow from the runs."""

from __future__ import annotations

import pytest
from poseppl_papers.tables import Table

from studies.verdicts import predictions, walks


def checked(*runs: tuple[float, str]) -> list[str]:
    columns = ("model", "filter", "seed", "frames", "coverage", "inflation", "errors")
    rows = [("growth", "hmc", seed, 100, coverage, 1.5, errors) for seed, (coverage, errors) in enumerate(runs)]
    return predictions.checks({"predictive_checks": Table("", columns, rows)}).splitlines()


def test_runs_are_missed_or_accused_by_the_bounds_of_the_goal():
    found = checked((0.79, "none"), (0.79, "prediction"), (0.8, "none"), (0.87, "other"), (0.88, "other"), (0.88, "none"))
    assert found[2] == "| growth | hmc | 6 | 84 (79 to 88) | 1.50 (1.50 to 1.50) | 3 | 1 of 2 | 1 of 2 |"
    assert found[-2] == "- Every run below 80 % has an error: does not hold; 1 of 2 are missed: growth with hmc (1)."
    assert found[-1] == "- No run above 87 % has one: does not hold; 1 of 2 are accused: growth with hmc (1)."


def test_the_goal_holds_where_none_is_missed():
    found = checked((0.79, "other"), (0.9, "none"), (0.84, "prediction"), (0.84, "none"))
    assert found[-2].endswith("has an error: holds; 0 of 1 are missed.") and found[-1].endswith("holds; 0 of 1 are accused.")


def test_recordings_are_one_row_and_named_where_they_are_missed():
    columns = ("model", "filter", "seed", "frames", "coverage", "inflation", "errors")
    rows = [(model, "hmc", 0, 100, share, 1.5, "none") for model, share in (("02_05, 1 camera", 0.7), ("run, 1 camera", 0.9))]
    rows += [("built-in walk, 2 cameras", "hmc", 0, 100, 0.9, 1.0, "none")]
    found = predictions.checks({"predictive_checks": Table("", columns, rows)}).splitlines()
    assert found[2].startswith("| recordings, 1 camera | hmc | 2 | 80 (70 to 90) ")
    assert found[3].startswith("| built-in walk, 2 cameras | hmc | 1 | 90 |")
    assert found[-2].endswith("does not hold; 1 of 1 are missed: 02_05, 1 camera with hmc (1).")


def walked(**differences: list[float]) -> str:
    columns = ("recording", "rate", "cameras", "walk", "frames", "seed", "error", "coverage", "seconds", "learning")
    rows = [
        (name, 120, 1, walk, 100, seed, 50.0 + seed + (each if walk == "learned" else 0.0), 0.9, 2.0, 1.0)
        for name, less in differences.items()
        for walk in ("second", "learned")
        for seed, each in enumerate(less)
    ]
    return walks.random_walks({"random_walk": Table("", columns, rows)}).splitlines()[-1]


@pytest.mark.parametrize(
    ("differences", "verdict"),
    [
        ({"a": [-9.0, -10.0, -11.0], "b": [-1.0, -1.1, -0.9]}, "holds"),
        ({"a": [-9.0, -10.0, -11.0], "b": [1.0, 1.1, 0.9]}, "does not hold"),
        ({"a": [-9.0, -10.0, -11.0], "b": [1.0, -10.0, 2.0]}, "undecided"),
        ({"a": [-9.0], "b": [-3.0]}, "undecided"),
    ],
)
def test_learned_scales_are_judged_by_intervals_of_paired_runs(differences, verdict):
    assert walked(**differences).split(": ")[1].startswith(f"{verdict};")


def test_the_interval_of_a_difference_is_students():
    less = walks.difference({walk: {s: {"error": e} for s, e in enumerate(errors)} for walk, errors in ERRORS.items()})
    # 1, 2 and 6 less than 10, 20 and 30: mean -3, deviation 2.646, over the root of 3, times 4.303
    assert less.mean == pytest.approx(-3) and less.reach == pytest.approx(6.57, abs=0.01) and less.verdict == "undecided"


ERRORS = {"second": [10.0, 20.0, 30.0], "learned": [9.0, 18.0, 24.0]}


@pytest.mark.full
def test_coverage_and_errors_are_reported_by_recording():
    columns = ("recording", "rate", "cameras", "walk", "frames", "seed", "error", "coverage")
    rows = [("02_01", 120, 2, walk, 100, 0, error, 0.7) for walk, error in (("frame", 57), ("second", 39), ("learned", 29))]
    found = walks.random_walks({"random_walk": Table("", columns, rows)}).splitlines()
    assert found[2] == "| 02_01 | 120 | 2 | 100 | 1 | 57, 70 % | 39, 70 % | 29, 70 % | -10 |  |"
    assert found[4].endswith("coverage is below 80 % on 1 (02_01) with learned scales, on 1 (02_01) without.")
