"""Figures of errors in images, of residuals whose bias, spread and expectation are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, stats

from poseppl.motion.verdicts.residuals import LARGEST, MIN_SHARE, ImageErrors

FRAMES, MARKERS = 4000, 2
BIAS, SPREAD = np.array([[0.0, 0.0], [12.0, -7.0]]), np.array([2.0, 5.0])


def normal(posterior: float = 0.0) -> ImageErrors:
    """Two cameras, the second with a bias. A posterior of so many px takes its variance from the residuals."""
    rng = np.random.default_rng(0)
    left = np.sqrt(SPREAD**2 - posterior**2)
    residual = BIAS[:, None] + left[:, None, None] * rng.standard_normal((FRAMES, 2, MARKERS, 2))
    noise = np.broadcast_to(SPREAD[:, None], residual.shape[:3])
    return ImageErrors(["left", "right"], residual, noise, np.full(residual.shape, posterior))


def test_bias_and_spread_are_medians() -> None:
    """A tenth of the points, far off to all sides, moves neither by much."""
    errors = normal()
    count = FRAMES * MARKERS
    assert (np.abs(errors.bias - BIAS) < 4 * 1.2533 * SPREAD[:, None] / np.sqrt(count)).all()
    np.testing.assert_allclose(errors.spread, SPREAD, rtol=4 * 1.17 / np.sqrt(2 * count))
    far = errors.residual.copy()
    far[::10] += 400 * np.random.default_rng(1).standard_normal(far[::10].shape)
    astray = errors._replace(residual=far)
    assert (np.abs(astray.bias - BIAS) < 0.3 * SPREAD[:, None]).all()
    np.testing.assert_allclose(astray.spread, SPREAD, rtol=0.25)


def test_what_a_posterior_knows_is_taken_off_the_expectation() -> None:
    errors = normal(1.5)._replace(residual=normal(1.5).residual - BIAS[:, None])
    np.testing.assert_allclose(errors.scale((0, 2, 3)), 1.0, rtol=4 / np.sqrt(4 * FRAMES * MARKERS))
    square, expected = errors.sums((0, 2, 3))
    np.testing.assert_allclose(expected, 2 * FRAMES * MARKERS * (1 - 1.5**2 / SPREAD**2), rtol=1e-9)
    assert square == pytest.approx(expected, rel=0.05) and errors.left_out == 0
    # a posterior nearly as wide as the noise leaves residuals without information
    sure = errors._replace(deviation=np.full(errors.residual.shape, SPREAD[0] * np.sqrt(1 - MIN_SHARE / 2)))
    assert sure.left_out == pytest.approx(0.5)
    assert np.isnan(sure.scale((0, 2, 3))[0])


def test_far_points_raise_a_scale_by_a_bounded_amount() -> None:
    """Of one camera's points 1 % are 70 standard deviations off: each counts as `LARGEST` of them, and in no other scale."""
    errors = normal()._replace(residual=normal().residual - BIAS[:, None])
    far, reach = errors.residual.copy(), 4 / np.sqrt(4 * FRAMES * MARKERS)
    far[::100, 0, :, 0] -= 70 * SPREAD[0]  # half of the coordinates
    expected = np.sqrt(1 + 0.005 * (LARGEST**2 - 1))
    np.testing.assert_allclose(errors._replace(residual=far).scale((0, 2, 3)), [expected, 1.0], rtol=reach)


@pytest.mark.parametrize("factor", [0.5, 3.0, 70.0])
def test_a_camera_that_is_far_off_as_a_whole_keeps_its_scale(factor: float) -> None:
    errors = normal()._replace(residual=factor * (normal().residual - BIAS[:, None]))
    np.testing.assert_allclose(errors.scale((0, 2, 3)), factor, rtol=4 / np.sqrt(4 * FRAMES * MARKERS))


def test_the_bound_changes_the_scale_of_normal_and_student_errors_as_stated() -> None:
    def scale(law: stats.rv_continuous) -> float:
        return float(
            np.sqrt(
                integrate.quad(lambda z: min(z**2, LARGEST**2) * law.pdf(z), -300, 300, points=(-4, 4), limit=500)[0]
                + LARGEST**2 * 2 * law.sf(300)
            )
        )

    assert 1 - scale(stats.norm()) == pytest.approx(1e-4, rel=0.5)
    assert 1 - scale(stats.t(4, scale=np.sqrt(0.5))) == pytest.approx(0.04, abs=0.005)


def test_a_minority_of_far_points_does_not_move_the_standardised_bias() -> None:
    errors = normal()
    far = errors.residual.copy()
    far[::50] -= 70 * SPREAD[:, None, None]
    expected = BIAS / SPREAD[:, None]
    np.testing.assert_allclose(errors._replace(residual=far).standardised_bias, expected, atol=0.1)
