"""What the page says of modes found follows from the rows."""

from __future__ import annotations

import pytest
from poseppl_papers.tables import Table

from studies.verdicts import modes

COLUMNS = ("pose", "method", "starts", "evaluations", "modes", "of", "mass")


def told(scaled: int, noise: int) -> list[str]:
    found = {
        "covariance scaled, 6 axes": scaled,
        "covariance scaled, random": 2,
        "dynamic noise": noise,
        "multiple hypotheses": 3,
    }
    found |= {"kinematic jumps": 4, "draws of the prior": 2}
    rows = [
        (pose, name, count, 10 * count, 1 + (count == 192) * (number - 1), 20 * (pose + 1), 0.5 + 0.25 * pose)
        for pose in range(2)
        for name, number in found.items()
        for count in (12, 48, 192)
    ]
    return modes.modes_found({"modes_found": Table("modes_found", COLUMNS, rows)}).splitlines()


@pytest.mark.full
@pytest.mark.parametrize(("scaled", "noise", "verdict"), [(11, 5, "holds"), (5, 11, "does not hold")])
def test_the_better_of_each_kind_decides(scaled, noise, verdict):
    lines = told(scaled, noise)
    best = {11: "5.2", 5: "2.1"}
    assert f"inflated noise: {verdict} here" in lines[-1]
    assert f"the best of it (covariance scaled, 6 axes) finds {best[scaled]} modes in 1,000 evaluations" in lines[-1]
    assert f"the best of noise (dynamic noise) {best[noise]}, kinematic jumps 1.6" in lines[-1]


@pytest.mark.full
def test_shares_are_means_over_poses():
    """11 of 20 modes and of 40: 55 and 27.5 %, of which the mean is shown."""
    assert told(11, 5)[2] == "| covariance scaled, 6 axes | 4 %, 62 % (120) | 4 %, 62 % (480) | 41 %, 62 % (1,920) |"
