"""What the page of Sminchisescu and Triggs says of modes found follows from the rows."""

from __future__ import annotations

import pytest
from poseppl_papers.experiment import UNDECIDED
from poseppl_papers.sminchisescu_triggs.spectra import modes_claim, modes_found
from poseppl_papers.tables import Table

COLUMNS = ("pose", "method", "starts", "evaluations", "modes", "of", "mass")


def tables_of(scaled: int, noise: int) -> dict[str, Table]:
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
    return {"modes_found": Table("modes_found", COLUMNS, rows)}


@pytest.mark.full
@pytest.mark.parametrize(("scaled", "noise", "verdict"), [(11, 5, "holds"), (5, 11, "does not hold")])
def test_the_better_of_each_kind_decides(scaled, noise, verdict):
    tables, best = tables_of(scaled, noise), {11: "5.2", 5: "2.1"}
    claim, last = modes_claim(tables), modes_found(tables).splitlines()[-1]
    assert claim.verdict == verdict and claim.ours.startswith(f"{best[scaled]} against {best[noise]} in 1,000 evaluations")
    assert f"the best of scaled covariances (covariance scaled, 6 axes) finds {best[scaled]} modes in 1,000 evaluations" in last
    assert f"the best of noise (dynamic noise) {best[noise]}, kinematic jumps 1.6" in last


@pytest.mark.full
def test_poses_decide_and_not_their_sum():
    """Much more on one pose and a little less on the other is more on the whole, and undecided."""
    rows = [
        (pose, name, count, 10 * count, 1 + number * (count == 192), 40, 0.5)
        for name, numbers in {"covariance scaled": (30, 8), "dynamic noise": (10, 10), "multiple hypotheses": (1, 1)}.items()
        for pose, number in enumerate(numbers)
        for count in (12, 48, 192)
    ]
    rows += [(0, name, count, 10, 1, 40, 0.5) for name in ("kinematic jumps", "draws of the prior") for count in (12, 48, 192)]
    assert modes_claim({"modes_found": Table("modes_found", COLUMNS, rows)}).verdict == UNDECIDED


@pytest.mark.full
def test_shares_are_means_over_poses():
    """11 of 20 modes and of 40: 55 and 27.5 %, of which the mean is shown."""
    assert (
        modes_found(tables_of(11, 5)).splitlines()[2]
        == "| covariance scaled, 6 axes | 4 %, 62 % (120) | 4 %, 62 % (480) | 41 %, 62 % (1,920) |"
    )
