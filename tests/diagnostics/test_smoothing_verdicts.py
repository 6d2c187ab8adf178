"""Verdicts on smoothed results without a truth: a smoother that is exact, wrong ones, and a wrong model."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import numpy as np
import pytest
import xarray as xr
from poseppl_models.toys.linear_gaussian import linear_gaussian
from synthetic import synthetic_result

from poseppl import infer, smooth
from poseppl.diagnostics import verdicts
from poseppl.diagnostics.smoothing import smoothing_figures
from poseppl.diagnostics.verdicts.consistency import smoothing
from poseppl.errors import InputError
from poseppl.filters import kalman_filter
from poseppl.runs.contents import FLAT
from poseppl.runs.posterior_checks import check_posterior
from poseppl.runs.predictive import predictive_checks
from poseppl.runs.results import encoded, provenance
from poseppl.runs.simulation import simulate
from poseppl.smoothers import rauch_tung_striebel_smoother, viterbi_smoother

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
    """Checks of a smoothed result whose draws (chain, draw, frame, state_dim) a wrong smoother has changed."""
    draws = change(tree[FLAT]["state"].values)
    wrong = tree.copy()
    wrong[FLAT] = xr.DataTree(tree[FLAT].to_dataset().assign(state=(tree[FLAT]["state"].dims, draws)))
    moments = {"state_mean": draws.mean((0, 1)), "state_sd": draws.std((0, 1))}
    summary = tree["summary"].to_dataset()
    wrong["summary"] = xr.DataTree(summary.assign({name: (("frame", "state_dim"), each) for name, each in moments.items()}))
    return check_posterior(wrong, MODEL, jax.random.key(3))


def scaled(factor: float) -> Change:
    """Other standard deviations about the same means."""
    return lambda draws: (1 - factor) * draws.mean(1, keepdims=True) + factor * draws


def errors(tree: xr.DataTree) -> list[str]:
    return [found.text for found in verdicts(tree) if found.severity == "error"]


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
        (scaled(0.5), "means differ less than"),
        (scaled(1.7), "Steps of the smoothed states"),
        (lambda draws: np.roll(draws, 1, 2), "The data are"),
        (lambda draws: draws + 3.0, "means differ more than"),
    ],
    ids=["narrow", "wide", "a frame late", "beside"],
)
def test_a_wrong_smoother_is_an_error(runs: list[Smoothing], change: Change, words: str) -> None:
    for each in runs:
        assert any(words in text for text in errors(checked(each.smoothed, change)))


@pytest.mark.full
def test_a_wrong_model_is_an_error_of_its_filter_and_of_its_smoother() -> None:
    """Data of noise that is three times as large as the model has it."""
    noise = np.sqrt(8 * 0.25) * np.random.default_rng(0).standard_normal((FRAMES, 1))
    tree = checked(run(data_of(0) + noise).smoothed)
    assert any(text.startswith("Filter before smoothing") for text in errors(tree))
    del tree["predictive"]
    assert errors(tree)


@pytest.mark.full
def test_a_smoother_that_fits_is_not_to_blame_for_its_filter(runs: list[Smoothing]) -> None:
    tree = checked(runs[0].smoothed)
    predictive = tree["predictive"].to_dataset()
    tree["predictive"] = xr.DataTree(predictive.assign(innovation=3 * predictive["innovation"]))
    found = [each.severity for each in verdicts(tree) if each.text.startswith("Filter before smoothing")]
    assert found == ["warning"]
    del tree["posterior_checks"]
    assert any(text.startswith("Filter before smoothing") for text in errors(tree))


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


def summed(**groups: dict[str, np.ndarray]) -> xr.DataTree:
    """A result that holds nothing but these variables, (frame, state_dim) or (frame,)."""

    def dataset(values: dict[str, np.ndarray]) -> xr.Dataset:
        return xr.Dataset({name: (("frame", "state_dim")[: each.ndim], each) for name, each in values.items()})

    return xr.DataTree.from_dict({name: dataset(values) for name, values in groups.items()})


def test_steps_are_reported_by_their_ratio_and_its_error() -> None:
    """Steps of 3 times the variance: of a draw and of the transition's other draw, (1 + 3) / 2 of what two draws differ by."""
    rng, frames, runs = np.random.default_rng(0), 401, 300
    variance = np.array([0.01, 4.0])
    found = []
    for _ in range(runs):
        steps, others = np.sqrt(variance) * rng.standard_normal((2, frames, 2))
        first = np.array([[np.nan], *[[1.0]] * (frames - 1)])
        checks = {"step_square": first * (np.sqrt(3) * steps + others) ** 2, "step_expected": first * 2 * variance}
        found.append(smoothing_figures(summed(posterior_checks=checks)).steps)
    estimates, errors_told = np.array([each[:2] for each in found]).T
    assert abs(estimates.mean() - 3) < 4 * estimates.std() / np.sqrt(runs)
    assert np.sqrt(np.square(errors_told).mean()) == pytest.approx(estimates.std(), rel=4 / np.sqrt(2 * runs))
    # the interval is Student's of 20 batches
    assert found[0].half_width == pytest.approx(2.093 * found[0].standard_error, rel=1e-3)


@pytest.mark.parametrize(("excess", "frames"), [(0.0, 12), (0.7, 12), (np.nan, 11)])
def test_the_distance_is_over_the_smoothed_variance_and_without_the_last_frame(excess: float, frames: int) -> None:
    """Means that differ by the loss of variance and by so much of the smoothed variance more; the last frames are alike.

    Fewer frames decide nothing.
    """
    rng = np.random.default_rng(1)
    before = rng.uniform(1.0, 2.0, (frames, 2)) * [1.0, 100.0]
    after = before * rng.uniform(0.2, 0.9, (frames, 2))
    after[-1] = before[-1]
    draws, draws_before = np.full(frames, 40.0), np.full(frames, 90.0)
    apart = np.sqrt(before - after + np.nan_to_num(excess) * after + before / 90 + after / 40)
    apart[-1] = 0.0
    tree = summed(
        filtered={"state_mean": np.zeros((frames, 2)), "state_sd": np.sqrt(before), "ess": draws_before},
        summary={"state_mean": apart, "state_sd": np.sqrt(after)},
        sample_stats={"ess": draws},
    )
    assert smoothing_figures(tree).distance.estimate == pytest.approx(excess, abs=1e-9, nan_ok=True)


@pytest.mark.parametrize(
    ("excess", "words"), [(1.5, "means differ more than"), (-0.6, "means differ less than")], ids=["farther", "nearer"]
)
@pytest.mark.parametrize(
    ("smoother", "filter", "blames_model"), [(True, True, True), (True, False, False), (False, True, False)]
)
def test_of_two_closed_forms_the_model_is_to_blame(
    excess: float, words: str, smoother: bool, filter: bool, blames_model: bool
) -> None:
    """There is no draw that could be to blame, nor an interval but by the model."""
    frames = np.ones((40, 2))
    tree = summed(
        filtered={"state_mean": 0 * frames, "state_sd": np.sqrt(2.0) * frames},
        summary={"state_mean": np.sqrt(1 + excess) * frames, "state_sd": frames},
    )
    tree.attrs = encoded({"smoother": "s", "closed form": smoother, "filter closed form": filter})
    (found,) = (each for each in smoothing(tree) if each.severity != "not run")
    assert words in found.text and f"{abs(excess):.2g} times the smoothed variance" in found.text
    assert ("the model does not describe the data" in found.text) == blames_model
    assert ("intervals" in found.text) == (not blames_model)
    tree.attrs |= encoded({"model of the filter": False})  # as of autocorrelated errors, which the filter does not know
    assert [each.severity for each in smoothing(tree)] == ["not run"]


def test_a_smoothed_result_knows_whether_its_filter_is_a_closed_form(runs: list[Smoothing]) -> None:
    assert provenance(runs[0].smoothed)["filter closed form"] is True


def test_a_most_probable_trajectory_has_no_uncertainty() -> None:
    """By what the smoother says of itself, not by its name."""
    assert viterbi_smoother(MODEL).provenance["optimizer"] and "optimizer" not in rauch_tung_striebel_smoother(MODEL).provenance
    tree = synthetic_result(num_frames=4, num_draws=1, num_chains=1, weighted=True)
    words = "its standard deviations and intervals mean nothing"
    assert not any(words in each.text for each in verdicts(tree))
    tree.attrs |= encoded({"smoother": "any", "closed form": True, "optimizer": True})
    assert [each.severity for each in verdicts(tree) if words in each.text] == ["warning"]
