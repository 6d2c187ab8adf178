"""The Monte Carlo error of few points, on the scalar filters of which the true error is known, and of the HMC filter."""

from __future__ import annotations

import jax
import numpy as np
import pytest
from poseppl_models.linear_gaussian import linear_gaussian
from test_unreached import FAINT, NOWHERE, filtered

from poseppl import infer
from poseppl.diagnostics import verdicts
from poseppl.diagnostics.few_points import few_points_inflation
from poseppl.filters import hmc_filter
from poseppl.kernels import HMCSettings
from poseppl.runs.predictive import predictive_checks
from poseppl.runs.simulation import simulate


@pytest.mark.parametrize("noise", [NOWHERE, FAINT, 3.0])
def test_the_least_inflation_is_at_most_the_true_one_and_most_of_it(noise: float) -> None:
    """Of 800 sequences of five points; it is of first order in 1 / n, which leaves less than 0.3 of what is beyond 1 out."""
    found = [filtered(noise, 0.9, ancestors=5, seed=seed) for seed in range(16)]
    least = np.mean([few_points_inflation(each.prediction, each.deviation, 5) for each in found]) - 1
    claimed = np.mean([np.square(each.deviation).sum(0) for each in found])
    errors = np.concatenate([np.square(each.mean - each.truth).sum(0) for each in found]) / claimed
    true, error = errors.mean() - 1, errors.std() / np.sqrt(len(errors))
    bounds = 0.7 * true - 4 * error, true + 4 * error
    assert bounds[0] < least < bounds[1] and least / 2 < bounds[0]  # half of it would be noticed


@pytest.mark.slow
@pytest.mark.parametrize(("chains", "severities"), [(10, ["error"]), (100, [])])
def test_ten_chains_are_too_few_where_the_past_lasts(chains: int, severities: list[str]) -> None:
    """Of a slope of 0.98, seen in noise of ten times the step, in thirty frames."""
    model = linear_gaussian(1, A=[[0.98]], Q=[[0.04]], R=[[4.0]]).compile()
    data = jax.tree.map(np.asarray, simulate(model, jax.random.key(0), 30).values)
    filter = hmc_filter(model, chains, HMCSettings(num_updates=10))
    result = infer(model, data, filter, jax.random.key(1), predict=predictive_checks(model))
    told = [each for each in verdicts(result) if "points carry the past" in each.text]
    assert [each.severity for each in told] == severities
    assert all("use --filter assumed-density" in each.text for each in told)
