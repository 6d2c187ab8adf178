"""The comparison of references with another algorithm, on normal numbers of known errors."""

from __future__ import annotations

import numpy as np
import pytest
from poseppl_papers.choo_fleet.reference_check import compare, references_agree
from poseppl_papers.tables import Table

RUNS, DIMENSION = 20, 28
COLUMNS = ("tracker", "recording", "frame", "runs", "mean_square", "by_chance", "largest", "probability")


def probabilities(off: float, number: int) -> list[float]:
    """Those of frames whose first coordinate's reference is off by so many of its standard errors."""
    rng = np.random.default_rng(3)
    variance, error = np.full(DIMENSION, 4.0), np.full(DIMENSION, 0.01)
    found = []
    for _ in range(number):
        mean = 0.01 * rng.normal(size=DIMENSION)
        mean[0] += off * 0.01
        found.append(compare(0.05 * rng.normal(size=(RUNS, DIMENSION)), mean, error, variance)[3])
    return found


def test_right_references_agree_and_wrong_ones_do_not():
    right = np.array(probabilities(0.0, 400))
    assert (right < 0.05).mean() < 0.05 + 3 * np.sqrt(0.05 * 0.95 / 400)  # Bonferroni's bound is no less
    assert (right < 0.5).mean() > 0.2
    assert np.median(probabilities(12.0, 50)) < 0.001


def test_mean_squares_are_in_posterior_variances():
    means = np.array([[1.0, 2.0], [3.0, 2.0]])
    square, chance, largest, _ = compare(means, np.array([1.0, 2.0]), np.array([0.5, 0.5]), np.array([2.0, 2.0]))
    assert square == pytest.approx((1.0 / 2 + 0.0) / 2)
    assert chance == pytest.approx((1.25 / 2 + 0.25 / 2) / 2)
    assert largest == pytest.approx(1 / np.sqrt(1.25))


@pytest.mark.parametrize(("probability", "verdict"), [(0.2, "holds"), (0.004, "does not hold")])
def test_all_frames_are_judged_together(probability, verdict):
    rows = [("arm", "walk", 3, 20, 2e-5, 1e-5, 3.0, probability), ("arm", "walk", 4, 20, 1e-5, 1e-5, 1.0, 0.9)]
    text = references_agree({"reference_check": Table("reference_check", COLUMNS, rows)})
    assert f"in 2 posteriors: {verdict} " in text and "5e-06 posterior variances" in text
    assert references_agree({}) == ""
