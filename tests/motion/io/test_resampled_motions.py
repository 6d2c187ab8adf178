"""Motions at other rates."""

from __future__ import annotations

import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.io import Motion, resample


def motion(frames=121, rate=120.0):
    times = np.arange(frames) / rate
    line = np.stack([1000 * times, -500 * times, 10 + 0 * times], -1)
    return Motion(("line", "arc"), np.stack([line, np.sin(line / 100)], 1), (), rate, "walk")


@pytest.mark.parametrize("wanted", [120.0, 60.0, 30.0, 24.0])
def test_frames_are_taken_as_they_are_where_the_rates_divide(wanted):
    found = resample(motion(), wanted)
    assert found.rate == wanted
    np.testing.assert_array_equal(found.positions, motion().positions[:: round(120 / wanted)])


@pytest.mark.parametrize("wanted", [25.0, 50.0, 29.97, 110.0])
def test_elsewhere_points_lie_between_at_their_true_times(wanted):
    found = resample(motion(), wanted)
    assert found.rate == pytest.approx(wanted, rel=1e-3)
    times = np.arange(len(found.positions)) / found.rate
    assert times[-1] <= 1.0 < times[-1] + 1 / found.rate
    np.testing.assert_allclose(found.positions[:, 0, 0], 1000 * times, atol=1e-9)
    error = np.abs(found.positions[:, 1] - np.sin(found.positions[:, 0] / 100)).max()
    assert error < (1000 / 100 / 120) ** 2 / 8  # that of a chord


def test_what_is_missing_stays_so_and_spreads_no_further():
    gap = motion()
    gap.positions[24, 0] = np.nan
    missing = np.isnan(resample(gap, 25.0).positions[:, 0, 0])
    assert np.flatnonzero(missing).tolist() == [5]  # frame 24 itself; at 23.04 and 24.96 others would
    gap.positions[25, 0] = np.nan
    assert np.flatnonzero(np.isnan(resample(gap, 50.0).positions[:, 0, 0])).tolist() == [10]


@pytest.mark.parametrize("wanted", [0.0, -5.0, 121.0, np.nan])
def test_rates_that_cannot_be_had(wanted):
    with pytest.raises(InputError, match="at most 120"):
        resample(motion(), wanted)
