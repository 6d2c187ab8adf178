"""Coverage of the trackers on sequences that the model itself simulates: the default one is calibrated, the paper's is not."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.simulated import build_problem
from studies.calibration import LEVELS, TRACKERS, study

BAND = (0.85, 0.95)
OVER_CONFIDENT = 0.75


def covers(name, sequences, frames):
    """Coverage of the 90 % intervals with its standard error over sequences, and the study."""
    problem = build_problem()
    found = study(TRACKERS[name](problem.model), problem, range(sequences), frames)
    return found.coverages[LEVELS.index(0.9)], found


@pytest.mark.slow
@pytest.mark.parametrize(("sequences", "frames"), [(8, 8), (24, 25)])
def test_coverage(sequences, frames):
    """The band within five standard errors for the default; the paper's as far below the band, or the check says nothing."""
    covered, default = covers("assumed-density (default)", sequences, frames)
    assert BAND[0] - 5 * covered.standard_error < covered.estimate < BAND[1] + 5 * covered.standard_error
    paper, narrow = covers("hmc (10 chains, L 40, R 32)", sequences, frames)
    assert paper.estimate < OVER_CONFIDENT
    assert paper.estimate < BAND[0] - 5 * paper.standard_error
    assert np.median(default.errors) < np.median(narrow.errors)
