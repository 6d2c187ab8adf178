"""Results in ArviZ's functions, in either of its major versions, with data missing; pointwise likelihoods by the formula."""

from __future__ import annotations

import warnings
from importlib.metadata import version

import jax
import jax.numpy as jnp
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from law_problems import problem
from oracles.kalman import kalman_filter, rauch_tung_striebel
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices, linear_gaussian_model
from scipy.stats import norm

import poseppl
from poseppl.errors import InputError
from poseppl.smoothers import rauch_tung_striebel_smoother

mpl.use("Agg")
with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import arviz as az

POSED = problem()
CLASSIC = int(version("arviz").partition(".")[0]) < 1
SEEN = np.asarray(POSED.observations.mask["y"])


@pytest.fixture(scope="module")
def result():
    kalman = poseppl.kalman_filter(POSED.model, num_particles=1000)
    collect = poseppl.collect_draws(POSED.model, max_draws=1000)
    filtered = poseppl.infer(POSED.model, POSED.observations, kalman, jax.random.key(0), POSED.inputs, collect=collect)
    smoother = rauch_tung_striebel_smoother(POSED.model, num_draws=1000)
    smoothed = poseppl.smooth(filtered, smoother, jax.random.key(1), POSED.inputs, collect=collect)
    return poseppl.add_predictive(smoothed, POSED.model, jax.random.key(2), POSED.inputs)


def test_each_datum_has_its_likelihood(result):
    terms, states = result["log_likelihood/y"], result["posterior/x"].values
    data, spread = result["observed_data/y"].values, np.sqrt(np.diagonal(POSED.matrices.R))
    exact = norm.logpdf(data, states @ POSED.matrices.H.T, spread)
    assert terms.dims == ("chain", "draw", "frame", *result["observed_data/y"].dims[1:])
    np.testing.assert_array_equal(np.isfinite(terms.values).all((0, 1)), SEEN)
    np.testing.assert_allclose(terms.values[..., SEEN], exact[..., SEEN], rtol=1e-3, atol=1e-4)


def test_replicates_are_data_of_the_draws(result):
    replicates, states = result["posterior_predictive/y"].values, result["posterior/x"].values
    residual = (replicates - states @ POSED.matrices.H.T) / np.sqrt(np.diagonal(POSED.matrices.R))
    assert (abs(residual.mean((0, 1))) < 5 / np.sqrt(1000)).all()
    assert (abs(residual.std((0, 1)) - 1) < 5 / np.sqrt(2 * 1000)).all()


@pytest.mark.full
@pytest.mark.filterwarnings("ignore")
def test_leave_one_out_is_that_of_the_exact_posterior():
    """A linear Gaussian model with much noise, so that importance weights vary little: the smoother of other data."""
    matrices = linear_gaussian_matrices(1, R=[[4.0]])
    ys, mask = np.array([[0.5], [-1.5], [0.0], [2.5], [3.0]]), np.ones((5, 1), bool)
    mask[2] = False
    model, number = linear_gaussian_model(matrices).compile(), 4000
    collect = poseppl.collect_draws(model, max_draws=number)
    filtered = poseppl.infer(model, {"y": np.where(mask, ys, np.nan)}, poseppl.kalman_filter(model), jax.random.key(0))
    smoother = rauch_tung_striebel_smoother(model, num_draws=number)
    smoothed = poseppl.smooth(filtered, smoother, jax.random.key(1), collect=collect)
    whole = poseppl.add_predictive(smoothed, model, jax.random.key(2))
    found = az.loo(poseppl.to_arviz(whole), pointwise=True)
    exact = np.array([left_out(matrices, ys, mask, row) for row in np.flatnonzero(mask)])
    weights = np.exp(-whole["log_likelihood/y"].values[0][:, mask[:, 0], 0])
    errors = weights.std(0) / weights.mean(0) / np.sqrt(number)
    per_datum = found.loo_i if CLASSIC else found.elpd_i
    assert (abs(per_datum.values - exact) < 5 * errors).all()
    in_sample = np.log((1 / weights).mean(0))
    assert (abs(in_sample - exact) > 5 * errors).any()  # what a datum says of itself counts
    assert found.n_data_points == mask.sum()


def left_out(matrices, ys, mask, row):
    """Log-density of a frame's datum under the smoother of all others."""
    seen = mask.copy()
    seen[row] = False
    means, covariances = rauch_tung_striebel(matrices, kalman_filter(matrices, ys, seen))
    return norm.logpdf(ys[row, 0], means[row, 0], np.sqrt(covariances[row, 0, 0] + matrices.R[0, 0]))


SHARED = {
    "summary": lambda az, data: az.summary(data),
    "ess": lambda az, data: az.ess(data),
    "rhat": lambda az, data: az.rhat(data),
    "mcse": lambda az, data: az.mcse(data),
    "hdi": lambda az, data: az.hdi(data),
    "extract": lambda az, data: az.extract(data, num_samples=10),
    "loo": lambda az, data: az.loo(data),
    "compare": lambda az, data: az.compare({"one": data, "other": data}),
    "loo_pit": lambda az, data: az.loo_pit(data, **({"y": "y"} if CLASSIC else {})),
    "plot_trace": lambda az, data: az.plot_trace(data, var_names=["x"]),
    "plot_forest": lambda az, data: az.plot_forest(data, var_names=["x"]),
    "plot_autocorr": lambda az, data: az.plot_autocorr(data, var_names=["x"]),
    "plot_rank": lambda az, data: (az.plot_rank if CLASSIC else az.plot_ridge)(data, var_names=["x"]),
    "plot_pair": lambda az, data: az.plot_pair(data, var_names=["x"], coords={"frame": [0]}),
    "plot_ess": lambda az, data: az.plot_ess(data, var_names=["x"]),
    "plot_mcse": lambda az, data: az.plot_mcse(data, var_names=["x"]),
    "plot_loo_pit": lambda az, data: az.plot_loo_pit(data, **({"y": "y"} if CLASSIC else {})),
    "plot_posterior": lambda az, data: (az.plot_posterior if CLASSIC else az.plot_dist)(data, var_names=["x"]),
    "plot_ppc": lambda az, data: (az.plot_ppc if CLASSIC else az.plot_ppc_dist)(data),
    "waic": lambda az, data: az.waic(data) if CLASSIC else az.eti(data),
}


@pytest.mark.full
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", SHARED)
def test_arviz_takes_a_result(result, name):
    assert SHARED[name](az, poseppl.to_arviz(result)) is not None
    plt.close("all")


@pytest.mark.full
def test_what_is_missing_is_left_out_for_arviz_alone(result):
    converted = poseppl.to_arviz(result)
    observed = converted["observed_data"]["y"]
    assert observed.dims == ("y_seen",) and np.isfinite(observed.values).all()
    np.testing.assert_array_equal(observed["y_frame"], np.argwhere(SEEN)[:, 0])
    assert result["observed_data/y"].shape == SEEN.shape
    assert converted["posterior_predictive"]["y"].shape == (1, 1000, SEEN.sum())


@pytest.mark.full
def test_a_result_without_data_is_reported(result):
    with pytest.raises(InputError, match="does not contain the data"):
        poseppl.add_predictive(result.drop_nodes("observed_data"), POSED.model, jax.random.key(0), jnp.asarray(POSED.inputs))
