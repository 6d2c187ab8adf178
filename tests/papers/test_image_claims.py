"""Verdicts on filters in images, from tables that are written by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from poseppl_papers.darby import claims as darby
from poseppl_papers.du_guan import claims as du_guan
from poseppl_papers.experiment import on_one_recording
from poseppl_papers.measured import Measured, difference, find, over_runs
from poseppl_papers.peursum import claims as peursum
from poseppl_papers.tables import Table


def sweep_table(plain: dict[float, list[float]], annealed: list[float]) -> Table:
    columns = ("diffusion", "filter", "exponent", "absolute", "ess_share")
    rows = [("peursum", "Simple-PF, 10,000", rate, error, 0.1) for rate, errors in plain.items() for error in errors]
    rows += [("peursum", "Simple-APF, 10 x 1,000", "", error, 0.5) for error in annealed]
    return Table("exponents", columns, rows + [("peursum-measured", *row[1:]) for row in rows])


@pytest.mark.parametrize(
    ("errors", "verdict"),
    [([60.0, 61.0, 62.0], "holds"), ([90.0, 91.0, 92.0], "does not hold"), ([50.0, 66.0, 90.0], "undecided")],
)
def test_a_sharpened_filter_is_judged_by_two_standard_errors(errors, verdict):
    table = sweep_table({10.0: errors, 60.0: [120.0, 121.0, 122.0]}, [59.0, 60.0, 61.0])
    found = peursum._sharpened({"exponents": table}).verdict.split("; ")
    no, verdict = (on_one_recording(each) for each in ("does not hold", verdict))
    expected = [f"{no} at lambda = 10, 60"] if verdict == no else [f"{verdict} at lambda = 10", f"{no} at lambda = 60"]
    heads = [f"with the {name} diffusion {expected[0]}" for name in ("published", "measured")]
    assert found == [heads[0], *expected[1:], heads[1], *expected[1:]]


@pytest.mark.parametrize(
    ("shares", "verdict"),
    [([0.1, 0.11], "holds"), ([0.4, 0.41], "does not hold"), ([0.01, 0.012], "does not hold"), ([0.1, 0.3], "undecided")],
)
def test_effective_sample_sizes_are_judged_by_lambda(shares, verdict):
    table = sweep_table({10.0: [60.0, 61.0]}, [60.0, 61.0])  # rows in pairs
    place = table.columns.index("ess_share")
    rows = [
        (*row[:place], shares[number % 2]) if row[1].startswith("Simple-PF") else row for number, row in enumerate(table.rows)
    ]
    claim = peursum._shared_out({"exponents": table._replace(rows=rows)})
    verdict = on_one_recording(verdict)
    expected = [f"with the {name} diffusion {verdict} at lambda = 10" for name in ("published", "measured")]
    assert claim.verdict.split("; ") == expected


@pytest.mark.parametrize(("relative", "verdict"), [(221.0, "holds"), (130.0, "does not hold")])
def test_a_filter_fails_that_is_worse_than_the_pose_it_starts_from(relative, verdict):
    columns = ("system", "method", "runs", "absolute", "absolute_sd", "relative", "relative_sd")
    rows = [("darby, Eq. 8", "(holds the first pose)", 1, 562.0, math.nan, 123.0, math.nan)]
    rows += [("darby, Eq. 8", "APF, 5 x 1,000", 10, 220.0, 9.0, relative, 15.0)]
    rows += [("darby, Eq. 9", "APF, 5 x 1,000", 10, 137.0, 6.0, 134.0, 6.0)]
    standard, modified = darby.claims({"one_camera": Table("", columns, rows)})
    # 130 - 2 * 15 / sqrt(10) is below 123
    assert standard.verdict == f"{verdict} on one recording" and "83 +- 3 less" in modified.ours
    assert modified.verdict == "holds on one recording"


@pytest.mark.parametrize(
    ("weight", "spread", "plain", "annealed"),
    [
        (0.02, 0.001, "does not hold", "does not hold"),
        (0.031, 0.0005, "does not hold", "does not hold"),  # more, and not by a tenth
        (0.1, 0.001, "holds", "does not hold"),
        (0.2, 0.001, "holds", "holds"),
        (0.17, 0.05, "holds", "undecided"),
    ],
)
def test_weights_are_compared_with_both_rivals(weight, spread, plain, annealed):
    columns = ("method", "runs", "evaluations", "absolute", "absolute_sd", "weight", "weight_sd")
    names = ("CONDENSATION, 5,000", "APF, 10 x 500", "DE-MC (velocity), 7 layers of 437", "DE-MC (transition), 7 layers of 437")
    weights = ((0.03, 0.0), (0.15, 0.0), (weight, spread), (weight, spread))
    rows = [(name, 3, 5000, 100.0, 1.0, *each) for name, each in zip(names, weights, strict=True)]
    velocity, transition, _ = du_guan.claims({"trackers": Table("", columns, rows)})
    assert velocity.verdict == f"CONDENSATION: {plain} on one recording; APF: {annealed} on one recording"
    assert transition.verdict == velocity.verdict and "(transition)" in transition.what


def growth_table(one: float, three: dict[int, float], error: float = 0.01) -> Table:
    rows = [(1, 500, 50, one, error), (1, "exact", 50, 0.35, np.nan), (3, "exact", 50, 0.35, np.nan)]
    rows += [(3, size, 50, share, error) for size, share in three.items()]
    return Table("dimensionality", ("dimension", "particles", "runs", "share", "share_standard_error"), rows)


@pytest.mark.parametrize(
    ("one", "three", "verdicts"),
    [
        (0.4, {500: 0.99, 1000: 0.99, 2000: 0.5}, ["holds", "holds"]),
        (0.49, {500: 0.99, 1000: 0.97}, ["undecided", "does not hold"]),
        (0.6, {500: 0.9}, ["does not hold", "does not hold"]),
    ],
)
def test_smoothing_is_judged_by_two_standard_errors(one, three, verdicts):
    assert [claim.verdict for claim in peursum.claims({"dimensionality": growth_table(one, three)})] == verdicts


@pytest.mark.parametrize(
    ("found", "reach", "verdict"),
    [
        ((80.0, 15.0, 5.0), 2.0, "holds"),
        ((60.0, 30.0, 10.0), 2.0, "does not hold"),
        ((71.0, 25.0, 4.0), 2.0, "undecided"),
    ],
)
def test_shares_of_basins_may_be_off_by_a_fifth(found, reach, verdict):
    rows = [(15.0, "quadrature", 90.0, 8.0, 2.0, 0.0, 0.0, 0.0, 0)]
    rows += [(15.0, "DE-MC", *found, reach, reach, reach, 20), (15.0, "HMC", 1.0, 90.0, 9.0, 1.0, 1.0, 1.0, 20)]
    rows += [(15.0, "Langevin dynamics, 200 steps an iteration", 4.0, 93.0, 3.0, 1.0, 1.0, 1.0, 20)]
    columns = ("temperature", "method", "a", "b", "c", "a_reach", "b_reach", "c_reach", "runs")
    sampled, trapped, both = du_guan.claims({"mueller": Table("mueller", columns, rows)})
    assert sampled.verdict == verdict and "DE-MC has most" in sampled.why
    assert trapped.verdict == "holds" and "93 +- 1 %" in trapped.ours and both.verdict == verdict


@pytest.mark.full
def test_errors_of_means_and_differences():
    measured = over_runs([1.0, 2.0, 3.0, 6.0])
    assert measured.mean == 3.0 and measured.spread == pytest.approx((14 / 3) ** 0.5) and measured.runs == 4
    assert measured.error == pytest.approx((14 / 12) ** 0.5)
    assert difference(Measured(5.0, 6.0, 4), Measured(1.0, 4.0, 1)) == (4.0, 5.0)
    assert Measured(5.04, math.nan, 1).text(1) == "5.0" and Measured(138.7, 10.9, 3).text() == "139 +- 11"
    table = Table("", ("name", "runs", "x", "x_sd"), [("a", 3, 1.0, 0.5), ("b", 4, 2.0, 0.7)])
    assert find(table, "x", name="b") == Measured(2.0, 0.7, 4)
