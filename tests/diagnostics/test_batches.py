"""Standard errors by batches of frames, against variances of means that are known."""

from __future__ import annotations

import numpy as np
import pytest

from poseppl.diagnostics.batches import log_ratio, mean_interval, num_batches, ratio_interval

RUNS = 3000


@pytest.mark.parametrize("frames", [4, 9])
def test_squared_errors_are_the_variance_of_a_mean_and_intervals_have_their_coverage(frames: int) -> None:
    """Frames that are independent and normal, in two and in three batches of equal length, where both are exact."""
    values = np.random.default_rng(frames).standard_normal((RUNS, frames))
    found = [mean_interval(row) for row in values]
    squares = np.square([each.standard_error for each in found])
    # s^2 / frames has the relative variance 2 / (batches - 1)
    assert abs(squares.mean() * frames - 1) < 4 * np.sqrt(2 / (num_batches(frames) - 1) / RUNS)
    inside = np.mean([abs(each.estimate) < each.half_width for each in found])
    assert abs(inside - 0.95) < 4 * np.sqrt(0.95 * 0.05 / RUNS)


def test_frames_that_repeat_themselves_are_worth_one_of_each() -> None:
    """Each value stands in as many frames as a batch has: the error is that of the mean of the values."""
    values = np.random.default_rng(0).standard_normal(10)
    found = mean_interval(np.repeat(values, 10))
    assert found.estimate == pytest.approx(values.mean())
    assert found.standard_error == pytest.approx(values.std(ddof=1) / np.sqrt(10))


def test_a_ratio_and_its_logarithm_err_as_they_vary() -> None:
    """By the standard deviation over many sequences of 400 frames; entries that are not known are left out of both."""
    rng = np.random.default_rng(1)
    b = rng.gamma(4.0, size=(RUNS // 5, 400))
    a = 3.0 * b + rng.gamma(2.0, size=b.shape)
    ratios = [ratio_interval(*rows) for rows in zip(a, b, strict=True)]
    logs = [log_ratio(*rows) for rows in zip(a, b, strict=True)]
    for found, true in ((ratios, 3.5), (logs, np.log(3.5))):
        estimates, errors = np.array([each[:2] for each in found]).T
        assert abs(estimates.mean() - true) < 4 * estimates.std() / np.sqrt(len(found)) + 1e-3
        assert np.sqrt(np.square(errors).mean()) == pytest.approx(estimates.std(), rel=4 / np.sqrt(2 * len(found)))
    known = ratio_interval(np.stack([a[0], np.full(400, np.nan)], 1), np.stack([b[0], b[1]], 1))
    assert known == pytest.approx(ratios[0])
