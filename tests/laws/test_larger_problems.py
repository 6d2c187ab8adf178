"""Laws on every smoother that is exact: twenty frames of four to eight coordinates, counts, and a state that is known in part.

Tolerances are 5 standard errors over independent replicates of filter and smoother. Two kinds stand for all; the others are
slow.
"""

from __future__ import annotations

import numpy as np
import pytest
from catalogue import SMOOTHERS
from law_problems import z_scores
from other_problems import clamped_and_smoothed, counted_and_smoothed, positive
from smoothing_problems import long_problem, replicator

QUICK = ("forward-backward", "backward-simulation-metropolis")
GAUSSIAN = ("rauch-tung-striebel", "variational")
"""Exact for linear Gaussian models alone."""
ROWS = [row for row in SMOOTHERS if row.consistent]


def exact_rows(names):
    marks = {name: () if name in QUICK else pytest.mark.slow for name in names}
    return pytest.mark.parametrize(
        "row", [pytest.param(row, id=row.name, marks=marks[row.name]) for row in ROWS if row.name in names]
    )


def check(row, *posed_by):
    posed, replicate = replicator(row, *posed_by)
    means, seconds = replicate()
    assert np.abs(z_scores(means, posed.means)).max() < 5
    assert np.abs(z_scores(seconds, posed.covariances)).max() < 5
    return posed, replicate


@exact_rows([row.name for row in ROWS])
def test_twenty_frames_of_four_coordinates(row):
    check(row, long_problem, 4)


@exact_rows([row.name for row in ROWS])
def test_a_part_of_the_state_that_is_known(row):
    posed, replicate = check(row, clamped_and_smoothed)
    if row.name in QUICK:  # known values of the wrong frame are noticed
        means, _ = replicate(late_inputs=1)
        assert np.abs(z_scores(means, posed.means)).max() > 20


@exact_rows([row.name for row in ROWS if row.name not in GAUSSIAN])
def test_counts_of_a_positive_rate(row):
    check(row, counted_and_smoothed, positive)
