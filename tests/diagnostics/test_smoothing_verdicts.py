"""Verdicts on smoothed results without a truth: a smoother that is exact, wrong ones, and a wrong model."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import numpy as np
import pytest
import xarray as xr
from poseppl_models.linear_gaussian import linear_gaussian

from poseppl import infer, smooth
from poseppl.diagnostics import verdicts
from poseppl.diagnostics.smoothing import smoothing_figures
from poseppl.errors import InputError
from poseppl.filters import kalman_filter
from poseppl.runs.contents import FLAT
from poseppl.runs.posterior_checks import check_posterior
from poseppl.runs.predictive import predictive_checks
from poseppl.runs.results import encoded
from poseppl.runs.simulation import simulate
from poseppl.smoothers import rauch_tung_striebel_smoother

FRAMES, SEEDS = 100, 4
MODEL = linear_gaussian(2, 1).compile()
Change = Callable[[np.ndarray], np.ndarray]


class Smoothing(NamedTuple):
    """A filter's result, and its smoothing by an exact smoother."""

    filtered: xr.DataTree
    smoothed: xr.DataTree


def run(data: np.ndarray) -> Smoothing:
    predict = predictive_checks(MODEL)
    result = infer(MODEL, {"y": data}, lambda model: kalman_filter(model, 500), jax.random.key(1), predict=predict)
    return Smoothing(result, smooth(result, rauch_tung_striebel_smoother(MODEL, num_draws=100), jax.random.key(2)))


def data_of(seed: int) -> np.ndarray:
    return np.asarray(simulate(MODEL, jax.random.key(seed), FRAMES).values["y"])


@pytest.fixture(scope="module")
def runs() -> list[Smoothing]:
    return [run(data_of(seed)) for seed in range(SEEDS)]


def checked(tree: xr.DataTree, change: Change = lambda draws: draws) -> xr.DataTree:
    """Checks of a smoothed result whose draws (chain, draw, frame, dof) a wrong smoother has changed."""
    draws = change(tree[FLAT]["state"].values)
    wrong = tree.copy()
    wrong[FLAT] = xr.DataTree(tree[FLAT].to_dataset().assign(state=(tree[FLAT]["state"].dims, draws)))
    moments = {"state_mean": draws.mean((0, 1)), "state_sd": draws.std((0, 1))}
    summary = tree["summary"].to_dataset()
    wrong["summary"] = xr.DataTree(summary.assign({name: (("frame", "dof"), each) for name, each in moments.items()}))
    return check_posterior(wrong, MODEL, jax.random.key(3))


def scaled(factor: float) -> Change:
    """Other standard deviations about the same means."""
    return lambda draws: (1 - factor) * draws.mean(1, keepdims=True) + factor * draws


def errors(tree: xr.DataTree) -> list[str]:
    return [found.text for found in verdicts(tree) if found.severity == "error"]


@pytest.mark.full
def test_an_exact_smoother_is_let_be(runs: list[Smoothing]) -> None:
    trees = [checked(each.smoothed) for each in runs]
    assert [errors(tree) for tree in trees] == [[]] * SEEDS
    # each figure is what it should be, to five standard errors of its mean over sequences
    for right, name in ((1.0, "data"), (1.0, "steps"), (0.0, "distance")):
        found = [getattr(smoothing_figures(tree), name) for tree in trees]
        error = np.sqrt(np.mean([each.standard_error**2 for each in found]) / SEEDS)
        assert abs(np.mean([each.estimate for each in found]) - right) < 5 * error, name


@pytest.mark.full
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (scaled(0.5), "nearer to the filtered ones"),
        (scaled(1.7), "Smoothed states step"),
        (lambda draws: np.roll(draws, 1, 2), "Data lie"),
        (lambda draws: draws + 3.0, "farther from the filtered ones"),
    ],
    ids=["narrow", "wide", "a frame late", "beside"],
)
def test_a_wrong_smoother_is_an_error(runs: list[Smoothing], change: Change, words: str) -> None:
    for each in runs:
        assert any(words in text for text in errors(checked(each.smoothed, change)))


def test_a_wrong_model_is_an_error_of_its_filter_and_of_its_smoother() -> None:
    """Data of noise that is three times as large as the model has it."""
    noise = np.sqrt(8 * 0.25) * np.random.default_rng(0).standard_normal((FRAMES, 1))
    tree = checked(run(data_of(0) + noise).smoothed)
    assert any(text.startswith("Of the filter that was smoothed") for text in errors(tree))
    del tree["predictive"]
    assert errors(tree)


@pytest.mark.full
def test_a_smoother_that_fits_is_not_to_blame_for_its_filter(runs: list[Smoothing]) -> None:
    tree = checked(runs[0].smoothed)
    predictive = tree["predictive"].to_dataset()
    tree["predictive"] = xr.DataTree(predictive.assign(innovation=3 * predictive["innovation"]))
    found = [each.severity for each in verdicts(tree) if each.text.startswith("Of the filter that was smoothed")]
    assert found == ["warning"]
    del tree["posterior_checks"]
    assert any(text.startswith("Of the filter that was smoothed") for text in errors(tree))


@pytest.mark.full
def test_what_cannot_be_checked(runs: list[Smoothing]) -> None:
    with pytest.raises(InputError, match="not smoothed"):
        check_posterior(runs[0].filtered, MODEL, jax.random.key(0))
    marginal = runs[0].smoothed.copy()
    marginal.attrs |= encoded({"joint": False})
    assert set(check_posterior(marginal, MODEL, jax.random.key(0))["posterior_checks"].data_vars) == {
        "data_square",
        "data_seen",
    }
    single = runs[0].smoothed.copy()
    single[FLAT] = xr.DataTree(single[FLAT].to_dataset().isel(draw=slice(3)))
    assert "posterior_checks" not in check_posterior(single, MODEL, jax.random.key(0)).children
