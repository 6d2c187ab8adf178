"""The page's statements about fast motion follow from the runs."""

from __future__ import annotations

import pytest
from poseppl_papers.tables import Table

from studies.verdicts import fast_motion

COLUMNS = ("recording", "rate", "case", "frames", "seed", "error", "coverage")
FIXED = [98.0, 100.0, 102.0]


def told(coverage: float = 0.9, **learned: list[float]) -> list[str]:
    rows = [
        (name, 30, case, 25, seed, error, coverage)
        for name, errors in learned.items()
        for case, values in (("fixed", FIXED), ("learned", errors))
        for seed, error in enumerate(values)
    ]
    return fast_motion.fast_motion({"fast_motion": Table("", COLUMNS, rows)}).splitlines()


def test_modes_of_a_recording_are_reported_in_one_row() -> None:
    columns = ("recording", "frames", "seed", "mass", "from_truth", "from_filter")
    rows = [("a", 25, 0, -3.4, 30.0, 50.0), ("b", 9, 0, 1.0, 7.0, 8.0), ("a", 25, 1, 2.6, 31.0, 52.0)]
    found = fast_motion.fast_motion_modes({"fast_motion_modes": Table("", columns, rows)}).splitlines()
    assert found[2:4] == ["| a | -3, +3 | 30, 31 | 50, 52 |", "| b | +1 | 7 | 8 |"]
    assert found[-1] == "The mode from the truth has the smaller mass in 1 of 3 runs."


def test_errors_and_differences_are_those_of_the_runs() -> None:
    found = told(run=[58.0, 60.0, 65.0])
    assert found[2:4] == ["| fixed | 100, 90 % |", "| learned | 61, 90 % |"]
    # -40, -40 and -37: mean -39, deviation 1.73 over the root of 3, times 4.303
    assert found[-4] == "| Learned scales less published ones | **-39 ± 4** |"


@pytest.mark.full
@pytest.mark.parametrize(
    ("errors", "verdict"),
    [
        (
            {"a": [30.0, 31.0, 32.0], "b": [40.0, 41.0, 42.0]},
            "holds; by 95 % intervals they do on 2 (a, b) and do not on none;",
        ),
        ({"a": [30.0, 31.0, 32.0], "b": [70.0, 71.0, 72.0]}, "does not hold; by 95 % intervals they do on 1 (a)"),
        ({"a": [30.0, 31.0, 32.0], "b": [30.0, 48.0, 69.0]}, "undecided; by 95 % intervals they do on 1 (a)"),
    ],
)
def test_halving_is_judged_by_intervals_of_paired_runs(errors: dict[str, list[float]], verdict: str) -> None:
    assert told(**errors)[-2].startswith(f"- Learned scales halve the errors: {verdict}")


@pytest.mark.full
@pytest.mark.parametrize(
    ("coverage", "verdict"), [(0.9, "holds; on 1 (a)."), (0.84, "does not hold; on none."), (0.96, "does")]
)
def test_intervals_are_judged_by_their_coverage(coverage: float, verdict: str) -> None:
    assert told(coverage, a=FIXED)[-1].startswith(f"- The coverage of their 90 % intervals is 85 to 95 %: {verdict}")
