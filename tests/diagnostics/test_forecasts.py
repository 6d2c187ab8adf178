"""Scores of forecasts against formulas of normal predictive distributions."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy.stats import norm

from poseppl.diagnostics import verdicts
from poseppl.diagnostics.forecasts import add_hindcasts, crps, score_forecast, score_hindcasts
from poseppl.diagnostics.verdicts.coverage import forecasts
from poseppl.errors import InputError
from poseppl.runs.results import Names, build_result


def test_scores_are_those_of_the_exact_predictive_distribution():
    """Over many futures the mean score is that of Gneiting and Raftery's formula, ranks and coverage are as they say."""
    rng = np.random.default_rng(0)
    scale, number = 2.0, 400
    truth = scale * rng.normal(size=number)
    draws = scale * rng.normal(size=(1, 500, number))
    ahead = tree_of(draws)
    score = score_forecast(ahead, {"y": np.where(np.arange(number) < 390, truth, np.nan)})["y"]
    z = truth[:390] / scale
    # the CRPS of a normal forecast at z standard deviations
    exact = scale * (z * (2 * norm.cdf(z) - 1) + 2 * norm.pdf(z) - 1 / np.sqrt(np.pi))
    assert np.isnan(score.crps[390:]).all() and np.isnan(score.transform[390:]).all()
    error = (score.crps[:390] - exact).std() / np.sqrt(390)
    assert abs(score.mean_crps - exact.mean()) < 5 * error + 5 * scale / np.sqrt(500 * 390)
    assert [abs(found.estimate - found.level) < 4 * found.standard_error for found in score.coverage] == [True] * 3
    # a forecast of half the spread scores worse, and does not cover
    narrow = score_forecast(tree_of(0.3 * draws), {"y": truth})["y"]
    assert narrow.mean_crps > score.mean_crps
    assert all(found.estimate < found.level - 4 * found.standard_error for found in narrow.coverage)


def test_few_draws_have_the_score_of_many():
    """The unbiased form; dividing by S^2 would add E|X - X'| / (2 S)."""
    rng = np.random.default_rng(1)
    few = crps(rng.normal(size=(4, 40_000)), np.zeros(40_000))
    exact = (np.sqrt(2) - 1) / np.sqrt(np.pi)
    error = few.std() / np.sqrt(40_000)
    assert (
        abs(few.mean() - exact)
        < 5 * error
        < 2 / np.sqrt(np.pi) / 8
        < abs(few.mean() + 2 / np.sqrt(np.pi) / 8 - exact) + 5 * error
    )


def test_data_that_do_not_fit_are_said():
    with pytest.raises(InputError, match="z: no site"):
        score_forecast(tree_of(np.zeros((1, 2, 3))), {"z": np.zeros(3)})
    with pytest.raises(InputError, match=r"y: data of shape \(4,\)"):
        score_forecast(tree_of(np.zeros((1, 2, 3))), {"y": np.zeros(4)})
    with pytest.raises(InputError, match="y: infinite data"):
        score_forecast(tree_of(np.zeros((1, 2, 3))), {"y": np.array([0.0, np.inf, np.nan])})


def tree_of(draws):
    return xr.DataTree.from_dict({"predictions": xr.Dataset({"y": (("chain", "draw", "frame"), draws)})})


def test_hindcasts_are_scored_by_the_frames_that_they_foretell():
    """Data that are their own frame's number, predicted exactly one frame ahead and off by one two frames ahead."""
    starts, frames = 30, 32
    data = np.arange(frames, dtype=float)
    data[7] = np.nan
    noise = 1e-3 * np.random.default_rng(0).normal(size=(1, 50, starts, 2))
    forecast_runs = np.arange(starts)[:, None] + np.array([1.0, 3.0]) + noise
    predicted = xr.Dataset({"y": (("chain", "draw", "start", "lead"), forecast_runs)}, {"start": range(starts), "lead": [1, 2]})
    result = xr.DataTree.from_dict({"observed_data": xr.Dataset({"y": ("frame", data)})})
    score = score_hindcasts(predicted, result)["y"]
    np.testing.assert_allclose(score.crps, [0.0, 1.0], atol=2e-3)
    assert (score.crps_error < 1e-2).all()
    assert [each.trials for each in score.coverage] == [29, 29] and score.coverage[1].estimate == 0.0 < score.coverage[
        0
    ].estimate


@pytest.mark.parametrize(("step", "severity"), [(1.0, None), (0.3, "error"), (4.0, "warning")])
def test_a_model_of_the_wrong_step_is_reported_by_its_forecasts(step, severity):
    """A random walk of steps of 1 that is seen without noise, forecast as one of other steps, up to four frames ahead."""
    rng = np.random.default_rng(5)
    frames, horizon = 204, 4
    walk = rng.standard_normal((frames, 2)).cumsum(0)
    starts = frames - horizon
    moves = step * rng.standard_normal((1, 200, starts, horizon, 2)).cumsum(3)
    dims = ("chain", "draw", "start", "lead", "entry")
    predicted = xr.Dataset({"y": (dims, walk[:starts, None] + moves)}, {"start": range(starts), "lead": range(1, horizon + 1)})
    result = build_result(state=rng.standard_normal((2, 50, frames, 1)), names=Names(("x",)), observed={"y": walk})
    told = [each for each in verdicts(add_hindcasts(result, predicted)) if "forecasts of y" in each.text]
    assert [each.severity for each in told] == ([] if severity is None else [severity])
    assert all("1 to 4 frames ahead" in each.text for each in told)


@pytest.mark.full
@pytest.mark.parametrize(("frames", "horizon"), [(30, 5), (60, 10), (200, 4)])
def test_right_forecasts_are_let_be(frames, horizon):
    """At most 5 % of 200 random walks with the right forecasts get a warning, and most of the wrong ones."""
    rng, runs = np.random.default_rng(0), 200
    starts = frames - horizon
    walks = rng.standard_normal((frames, runs)).cumsum(0)
    moves = rng.standard_normal((99, starts, horizon, 1)).cumsum(2)
    forecast_runs = {step: walks[:starts, None] + step * moves for step in (1.0, 0.3)}

    def warned(step):
        found = 0
        for run in range(runs):
            draws = forecast_runs[step][None, ..., run]
            predicted = xr.Dataset(
                {"y": (("chain", "draw", "start", "lead"), draws)}, {"start": range(starts), "lead": range(1, horizon + 1)}
            )
            result = xr.DataTree.from_dict({"observed_data": xr.Dataset({"y": ("frame", walks[:, run])})})
            found += any(forecasts(add_hindcasts(result, predicted)))
        return found / runs

    assert warned(1.0) <= 0.05 and warned(0.3) > 0.5
