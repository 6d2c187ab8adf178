"""The Monte Carlo error of few points, on the scalar filters of which the true error is known, and of the HMC filter."""

from __future__ import annotations

import jax
import numpy as np
import pytest
from poseppl_models.toys.linear_gaussian import linear_gaussian
from test_unreached import FAINT, NOWHERE, filtered

from poseppl import infer
from poseppl.diagnostics import verdicts
from poseppl.diagnostics.unreached import finite_sample_inflation
from poseppl.filters import hmc_filter
from poseppl.kernels import HMCSettings
from poseppl.runs.predictive import StatePrediction, predictive_checks
from poseppl.runs.simulation import simulate


@pytest.mark.full
@pytest.mark.parametrize("noise", [NOWHERE, FAINT, 3.0])
def test_the_least_inflation_is_at_most_the_true_one_and_most_of_it(noise: float) -> None:
    """The mean over 800 sequences of five points; the first order in 1 / n leaves out less than 0.3 of the excess over 1."""
    found = [filtered(noise, 0.9, ancestors=5, seed=seed) for seed in range(16)]
    least = np.mean([finite_sample_inflation(each.prediction, each.deviation, 5) for each in found]) - 1
    claimed = np.mean([np.square(each.deviation).sum(0) for each in found])
    errors = np.concatenate([np.square(each.mean - each.truth).sum(0) for each in found]) / claimed
    true, error = errors.mean() - 1, errors.std() / np.sqrt(len(errors))
    bounds = 0.7 * true - 4 * error, true + 4 * error
    assert bounds[0] < least < bounds[1] and least / 2 < bounds[0]  # half of it would be noticed


def _common(
    rng: np.random.Generator, points: int, frames: int = 100
) -> tuple[StatePrediction, np.ndarray, np.ndarray, np.ndarray]:
    """A filter that knows the past by n points, of two coordinates whose difference is seen: checks, draws, P_t, errors^2.

    Squares of errors are their expectation given the data, from the exact filter.
    """
    A, H, R = 0.98 * np.eye(2), np.array([[1.0, -1.0]]), 0.1
    W = np.array([[5.05, -4.95], [-4.95, 5.05]])  # 10 of the difference, 0.1 of the sum

    def updated(mean: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        Q = A @ P @ A.T + W
        gain = Q @ H.T / (H @ Q @ H.T + R)
        return A @ mean + gain @ (data - H @ A @ mean), Q - gain @ H @ Q, gain

    exact = P = np.array([[6.0, 1.0], [1.0, 6.0]])
    truth, best = rng.multivariate_normal(np.zeros(2), P), np.zeros(2)
    mean, told = best, []
    for _ in range(frames):
        truth = rng.multivariate_normal(A @ truth, W)
        data = H @ truth + np.sqrt(R) * rng.standard_normal(1)
        (best, exact, _), (mean, C, gain) = updated(best, exact), updated(mean, P)
        past = rng.multivariate_normal(mean, C, points)
        slope = 0.98 + np.zeros(2)
        told.append(
            (
                1 - np.diag(C) / np.diag(A @ P @ A.T + W),
                slope,
                (np.eye(2) - gain @ H) @ A,
                past,
                np.diag(C),
                np.diag(exact) + (mean - best) ** 2,
            )
        )
        mean, P = past.mean(0), past.T @ past / points - np.outer(past.mean(0), past.mean(0))
    explained, slopes, transfer, draws, variance, squares = (np.array(each) for each in zip(*told, strict=True))
    checks = StatePrediction(None, None, None, slopes, explained, transfer=transfer)
    return checks, draws.swapaxes(0, 1), variance, squares


@pytest.mark.full
def test_what_coordinates_have_in_common_is_handed_on() -> None:
    """Data explain four fifths of each of two coordinates, but nothing of their persistent sum. Mean over 600 sequences."""
    rng = np.random.default_rng(0)
    found = [_common(rng, 60) for _ in range(600)]
    told = [
        [finite_sample_inflation(checks, np.sqrt(P), 60, each).mean() - 1 for each in (draws, None)]
        for checks, draws, P, _ in found
    ]
    least, apart = np.mean(told, axis=0)
    ratio = np.array([(squares.sum(0) / P.sum(0)).mean() for *_, P, squares in found])
    true, error = ratio.mean() - 1, ratio.std() / np.sqrt(len(ratio))
    bounds = 0.7 * true - 4 * error, true + 4 * error
    assert bounds[0] < least < bounds[1] and max(least / 2, apart) < bounds[0]  # half, or each on its own, would be noticed


@pytest.mark.slow
@pytest.mark.parametrize(("chains", "severities"), [(10, ["error"]), (100, [])])
def test_ten_chains_are_too_few_where_the_past_lasts(chains: int, severities: list[str]) -> None:
    """The slope is 0.98, the noise ten times the step, in thirty frames."""
    model = linear_gaussian(1, A=[[0.98]], Q=[[0.04]], R=[[4.0]]).compile()
    data = jax.tree.map(np.asarray, simulate(model, jax.random.key(0), 30).values)
    filter = hmc_filter(model, chains, HMCSettings(num_updates=10))
    result = infer(model, data, filter, jax.random.key(1), predict=predictive_checks(model))
    told = [each for each in verdicts(result) if "points carry the past" in each.text]
    assert [each.severity for each in told] == severities
    assert all("use filter='assumed-density'" in each.text for each in told)
