"""Points that leap away for a frame, beside one that moves fast, and others that stand still."""

from __future__ import annotations

import numpy as np

from poseppl.motion.keypoints.leaps import despike


def test_a_leap_is_left_out_and_a_fast_point_is_not() -> None:
    points = np.zeros((20, 1, 4, 2))
    points[..., 1] = [0.0, 100.0, 200.0, 300.0]
    points[:, 0, 3, 0] = 80.0 * np.arange(20)
    points[7, 0, 1, 0] = 90.0
    points[12, 0, 2] = np.nan
    found = despike(points, 50.0)
    left_out = np.isnan(found).any(-1)[2:-2, 0]
    assert np.argwhere(left_out).tolist() == [[5, 1], [10, 2]]
    kept = np.isfinite(found)
    np.testing.assert_array_equal(found[kept], points[kept])
    assert np.isfinite(despike(points, 95.0)[7, 0, 1]).all()
