from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from synthetic import autoregression

from poseppl.diagnostics import LEVELS, coverage, inside_interval, probability_transform
from poseppl.motion.measures import joint_error

RNG = np.random.default_rng


@pytest.mark.parametrize("level", LEVELS)
def test_exact_gaussians_are_covered_at_the_nominal_rate(level: float) -> None:
    """Within 5 standard errors and the bias of quantiles of 400 draws; half the spread must fail."""
    rng = RNG(0)
    draws, truth = rng.standard_normal((4, 100, 500, 6)), rng.standard_normal((500, 6))
    found = coverage(inside_interval(draws, truth, level), level)
    assert abs(found.estimate - level) < 5 * found.standard_error + 0.005
    narrow = coverage(inside_interval(draws / 2, truth, level), level)
    assert narrow.estimate + 5 * narrow.standard_error + 0.005 < level


@pytest.mark.full
def test_standard_error_is_honest_about_neighbouring_frames() -> None:
    """Against the spread over replicates: correlated frames give the right size, and binomial errors would not."""
    estimates, errors = [], []
    for seed in range(200):
        truth = autoregression(RNG(seed), (1, 1000, 1), 0.9)[0]
        found = coverage(np.abs(truth) < stats.norm.ppf(0.95), 0.9)
        estimates.append(found.estimate)
        errors.append(found.standard_error)
    spread = np.std(estimates, ddof=1)
    assert 0.7 * spread < np.mean(errors) < 1.3 * spread
    assert np.sqrt(0.09 / 1000) < 0.7 * spread


def test_several_sequences_are_the_unit() -> None:
    """One sequence wholly outside and nine wholly inside: 10 trials, not 1000."""
    parts = [np.ones((100, 2), bool)] * 9 + [np.zeros((100, 2), bool)]
    found = coverage(parts, 0.9)
    assert found.estimate == 0.9
    np.testing.assert_allclose(found.standard_error, np.sqrt(0.09 / 9))


def test_perfect_coverage_has_an_error_and_no_trial_is_nan() -> None:
    assert coverage(np.ones((50, 2), bool), 0.9).standard_error > 0
    nothing = coverage(np.ones((5, 2), bool), 0.9, valid=np.zeros((5, 2), bool))
    assert nothing.trials == 0
    assert np.isnan(nothing.estimate)


@pytest.mark.full
def test_joint_error_absolute_and_relative() -> None:
    truth = RNG(1).normal(0, 500, (7, 4, 3))
    mean = truth + [30.0, 40.0, 0.0]
    mean[:, 3] += [0.0, 0.0, 12.0]
    error = joint_error(mean, truth, root=1)
    np.testing.assert_allclose(error.absolute[:, :3], 50, rtol=1e-10)
    np.testing.assert_allclose(error.absolute[:, 3], np.hypot(50, 12), rtol=1e-10)
    np.testing.assert_allclose(error.relative, np.broadcast_to([0, 0, 0, 12], (7, 4)), atol=1e-9)


@pytest.mark.full
def test_probability_transform_is_uniform_only_when_calibrated() -> None:
    rng = RNG(2)
    draws, truth = rng.standard_normal((2, 200, 2000, 1)), rng.standard_normal((2000, 1))
    assert stats.kstest(probability_transform(draws, truth).ravel(), "uniform").pvalue > 1e-3
    assert stats.kstest(probability_transform(draws / 2, truth).ravel(), "uniform").pvalue < 1e-6
