"""The page's statements about simulated keypoints and ranks follow from the runs."""

from __future__ import annotations

import pytest
from poseppl_papers.tables import Table

from studies.verdicts.simulated_keypoints import BINS, clocks, ranks, recorded

COLUMNS = ("recording", "cameras", "case", "what", "ideal", "median", "percentile_95", "coverage_50", "coverage_90", "width")
LIMBS = ("recording", "cameras", "case", "aligned", "exchanged", "found", "falsely", "pairs")


def page(errors: list[float], held: list[float]) -> str:
    """Recordings with these errors of one determined angle, beside one that is not determined and one that cannot move."""
    rows, limbs = [], []
    for number, (error, share) in enumerate(zip(errors, held, strict=True)):
        key = (f"walk {number}", 4, "no clutter")
        rows.append((*key, "places", 20.0, 15.0, 40.0, 0.5, share, 60.0))
        rows.append((*key, "knee", 5.0, error, 9.0, 0.5, share, 12.0))
        rows.append((*key, "head", 57.0, 30.0, 60.0, 0.5, 0.1, 90.0))
        rows.append((*key, "stiff", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        limbs.append((*key, 14.0, 3, 2, 1, 480))
    return recorded({"simulated_keypoints": Table("", COLUMNS, rows), "simulated_limbs": Table("", LIMBS, limbs)})


@pytest.mark.parametrize(
    ("errors", "held", "angles", "intervals"),
    [
        ([1.0, 1.1, 0.9], [0.9, 0.91, 0.89], "holds", "holds"),
        ([3.0, 3.1, 2.9], [0.99, 0.99, 0.98], "does not hold", "does not hold"),
        ([1.0, 2.5, 3.0], [0.86, 0.99, 0.9], "undecided", "undecided"),
    ],
)
def test_goals_are_judged_by_intervals_over_recordings(errors, held, angles, intervals):
    found = page(errors, held)
    assert f"4 cameras: within 2 degrees in the median {angles};" in found
    assert f"intervals of the joints {intervals}, of the angles {intervals}." in found
    assert found.endswith("left out of the angles above: head.") and "stiff" not in found
    assert "| 9 of 1440 | 6 | 3 |" in found and "30 degrees off in the median, no clutter: none." in found


def test_an_angle_that_is_another_one_is_named():
    assert "off in the median, no clutter: knee of walk 1 (4 cameras)." in page([1.0, 40.0, 1.0], [0.9, 0.9, 0.9])


@pytest.mark.parametrize(
    ("smoother", "chance", "ece", "told"),
    [
        ("right", 0.2, 0.01, "uniform holds; ECE below 0.05 holds."),
        ("right", 0.001, 0.045, "uniform does not hold; ECE below 0.05 does not hold."),
        ("half", 0.001, 0.2, "that it is wrong is noticed."),
        ("half", 0.2, 0.01, "that it is wrong is not noticed."),
    ],
)
def test_ranks_are_judged_by_their_chance(smoother, chance, ece, told):
    columns = ("smoother", "cameras", "of", "replicates", *BINS, "statistic", "chance", "ece", "ece_error")
    row = (smoother, 4, "joints", 50, *[0.1] * 10, 9.0, chance, ece, 0.005, 0.5, 0.9)
    found = ranks({"smoother_ranks": Table("", (*columns, "coverage_50", "coverage_90"), [row])})
    assert found.endswith(f"- joints, 4 cameras, {smoother}: {told}")


@pytest.mark.full
@pytest.mark.parametrize(("wrong", "lost", "verdict"), [(0, 0, "holds"), (1, 0, "does not hold"), (0, 1, "does not hold")])
def test_clocks_are_not_to_be_corrected_wrongly(wrong, lost, verdict):
    columns = ("recording", "late", "clutter", "calibration", "error", "deviation", "covered", "wrong", "lost")
    rows = [("a", "no", "no", "0", 0.2, 0.1, 2, 0, 0), ("b", "no", "no", "0", 0.4, 0.1, 3, wrong, lost)]
    found = clocks({"simulated_clocks": Table("", columns, rows)})
    assert f"| 0.40 | 0.10 | 5 of 6 | {wrong} of 6 | {lost} of 8 |" in found and found.endswith(f"lost {verdict}.")
