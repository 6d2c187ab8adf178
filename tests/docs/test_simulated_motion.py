"""The page's statements about simulated motion follow from the rows."""

from __future__ import annotations

import numpy as np
import pytest
from poseppl_papers.tables import Table

from studies.verdicts.simulated_motion import coordinates, simulated_motion

COLUMNS = ("setting", "sequence", "error", "in_50", "in_90", "seconds")


def told(default, other, in_50=0.5, in_90=0.9, seconds=0.01):
    """The text for errors of the default and of another setting by sequence."""
    rows = [
        (name, sequence, error, in_50 + 0.002 * (sequence % 2), in_90 + 0.002 * (sequence % 2), seconds)
        for name, errors in (("default", default), ("nearly exact", other), ("lesser modes kept", other))
        for sequence, error in enumerate(errors)
    ]
    return simulated_motion({"simulated_motion": Table("simulated_motion", COLUMNS, rows)}).splitlines()


def of_rival(lines):
    return next(line for line in lines if line.startswith("- lesser modes kept"))


ERRORS = 40 + np.arange(20) / 10


def test_goals_that_are_reached():
    lines = told(ERRORS, ERRORS - 1)
    assert lines[2].startswith("| default | 20 | 41.0 (40.7 to 41.2) | 0 (largest 42) | 90.1 (90.1 to 90.1) % |")
    assert sum(": holds (" in line for line in lines) == 6
    assert "smaller by 1.0 mm (1.0 to 1.0), holds" in of_rival(lines)


def test_goals_that_are_not():
    """One lost sequence of twenty moves the mean by no more than its interval; other intervals and slow frames do not hold."""
    lost = np.where(np.arange(20) == 3, 300.0, ERRORS)
    goals = [line for line in told(lost, ERRORS, in_50=0.4, in_90=0.8, seconds=0.03) if line.startswith("- Goal: ")]
    assert [line.split(": ")[2].split(" (")[0] for line in goals] == ["does not hold"] * 2 + ["undecided"] + [
        "does not hold"
    ] * 2
    assert "(1 of 20)" in goals[3] and "(33)" in goals[4]
    difference = of_rival(told(lost, ERRORS))
    assert "undecided; above 100 mm with the default alone 1, with lesser modes kept alone 0 (sign test, p = 1)" in difference


@pytest.mark.full
def test_a_goal_that_the_posterior_itself_misses():
    last = told(ERRORS, ERRORS + 20)[-1]
    assert last.endswith(
        "does not hold (61.0 (60.7 to 61.2), and the coverage of its 90 % intervals is 90.1 (90.1 to 90.1) %)."
    )


@pytest.mark.full
def test_angles_are_compared_sequence_by_sequence():
    """Deviations half as wide as those of NUTS in each sequence that both have, and shares that it raises by a quarter."""
    rows = [("default", sequence, "trunk", 0.5, 0.1 * (1 + sequence), 0.3) for sequence in range(12)]
    rows += [("default, then NUTS", sequence, "trunk", 0.75, 0.1, 0.2) for sequence in range(12)]
    rows += [("NUTS from the truth", sequence, "trunk", 0.9, 0.2 * (1 + sequence), 0.4) for sequence in range(2, 12)]
    columns = ("method", "sequence", "part", "inside", "deviation", "error")
    lines = coordinates({"simulated_coordinates": Table("simulated_coordinates", columns, rows)}).splitlines()
    assert lines[2] == "| default | trunk | 12 | 50.0 (50.0 to 50.0) % | 0.74 | 0.30 |"
    gain, ratio = lines[-2:]
    assert (
        gain.startswith("- default, then NUTS: gain of coverage over the default")
        and "trunk 25.0 (25.0 to 25.0) points" in gain
    )
    assert ratio.startswith("- NUTS from the truth") and "trunk 40.0 (40.0 to 40.0) points, ratio 0.50 (0.50 to 0.50)" in ratio
