"""A result's intervals against draws of another: a right one, a narrow one, and one of other frames."""

from __future__ import annotations

import numpy as np
import pytest

from poseppl.diagnostics import reference_coverage
from poseppl.errors import InputError
from poseppl.runs.results import Names, build_result


def result(width, frames=60, seed=0):
    draws = np.arange(frames)[:, None] + width * np.random.default_rng(seed).standard_normal((2, 2000, frames, 2))
    draws[..., 1] = 3.0  # is known exactly
    return build_result(state=draws, names=Names(("x", "y")))


def test_the_share_is_that_of_the_reference_in_the_intervals():
    right = reference_coverage(result(1.0), result(1.0, seed=1))
    assert abs(right.estimate - 0.9) < 0.01 and right.standard_error < 0.01
    # P(|Z| < 1.645 / 2) of a normal Z
    assert abs(reference_coverage(result(0.5), result(1.0, seed=1)).estimate - 0.589) < 0.01


@pytest.mark.full
def test_other_frames_are_refused():
    with pytest.raises(InputError, match="reference"):
        reference_coverage(result(1.0), result(1.0, frames=50))
