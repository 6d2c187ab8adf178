"""Results in the user's own space: constrained sites as the programs know them, probabilities of finite ones."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from law_problems import TWO_STATES
from oracles.forward_backward import forward_backward
from poseppl_models.toys.finite_hmm import finite_hmm
from scipy.special import expit

import poseppl
from poseppl.filters import hidden_markov_filter
from poseppl.runs.results import load_result, save_result
from poseppl.runs.site_summary import summary_of_sites


def initial(params, inputs):
    numpyro.sample("level", dist.Normal(0.0, 1.0).expand([2]).to_event(1))
    numpyro.sample("rate", dist.LogNormal(0.0, 0.5))
    numpyro.sample("mix", dist.Dirichlet(jnp.array([2.0, 3.0, 4.0])))
    numpyro.sample("regime", dist.Categorical(jnp.array([0.2, 0.3, 0.5])))
    numpyro.sample("count", dist.Poisson(3.0))


def transition(params, state, inputs):
    numpyro.sample("level", dist.Normal(state["level"], 0.1).to_event(1))
    numpyro.sample("rate", dist.LogNormal(jnp.log(state["rate"]), 0.1))
    numpyro.sample("mix", dist.Dirichlet(50 * state["mix"] + 0.5))
    numpyro.sample("regime", dist.Categorical(jnp.where(jnp.arange(3) == state["regime"], 0.8, 0.1)))
    numpyro.sample("count", dist.Poisson(3.0))


def observation(params, state, inputs):
    numpyro.deterministic("twice", 2 * state["rate"])
    numpyro.sample("y", dist.Normal(state["level"].sum() + state["regime"], state["rate"]))


@pytest.fixture(scope="module")
def result():
    model = poseppl.StateSpaceModel(initial, transition, observation).compile()
    data = {"y": [0.3, 1.0, float("nan"), 2.0]}
    return poseppl.infer(model, data, poseppl.particle_filter(model, 400), jax.random.key(0))


def test_sites_keep_their_names_values_and_shapes(result):
    posterior, flat = result["posterior"], result["unconstrained_posterior/state"]
    shapes = {name: values.shape[3:] for name, values in posterior.data_vars.items()}
    assert shapes == {"level": (2,), "rate": (), "mix": (3,), "regime": (), "count": (), "twice": ()}
    assert list(flat["state_dim"].values) == ["level[0]", "level[1]", "rate", "mix[0]", "mix[1]", "regime", "count"]
    np.testing.assert_allclose(posterior["rate"], np.exp(flat.sel(state_dim="rate")), rtol=1e-5)
    np.testing.assert_allclose(posterior["twice"], 2 * posterior["rate"], rtol=1e-6)
    np.testing.assert_allclose(posterior["mix"].sum("mix_dim_0"), 1, rtol=1e-5)
    first = expit(flat.sel(state_dim="mix[0]").values - np.log(2))
    np.testing.assert_allclose(posterior["mix"][..., 0], first, rtol=1e-4)
    assert posterior["regime"].dtype.kind == "i" and set(np.unique(posterior["regime"])) <= {0, 1, 2}


def test_summaries_are_of_the_sites_own_values(result):
    summary, posterior = result["summary"], result["posterior"]
    # over all 400 particles, of which 200 draws are kept, systematically resampled
    spread = posterior["rate"].std(("chain", "draw"))
    assert (abs(summary["rate_mean"] - posterior["rate"].mean(("chain", "draw"))) < 5 * spread / np.sqrt(200)).all()
    assert (abs(np.exp(summary["state_mean"].sel(state_dim="rate")) - summary["rate_mean"]) > 1e-3).any()
    np.testing.assert_array_equal(summary["level_mean"], summary["state_mean"][:, :2])
    np.testing.assert_array_equal(summary["level_quantile"], summary["state_quantile"][..., :2])
    np.testing.assert_array_equal(summary["count_mean"], summary["state_mean"].sel(state_dim="count"))
    np.testing.assert_allclose(summary["mix_mean"].sum("mix_dim_0"), 1, rtol=1e-5)
    np.testing.assert_allclose(summary["regime_probability"].sum("regime_value"), 1, rtol=1e-5)
    assert "regime_mean" not in summary and "regime_quantile" not in summary


@pytest.mark.full
def test_a_saved_result_keeps_sites_and_values(result, tmp_path):
    save_result(result, tmp_path / "result.nc")
    again = load_result(tmp_path / "result.nc")
    assert again["posterior"].equals(result["posterior"])
    assert again["summary/regime_probability"]["regime_value"].values.tolist() == [0, 1, 2]


@pytest.mark.full
def test_state_probabilities_are_those_of_forward_backward():
    """Filtered, exactly, by the hidden Markov filter; by particles within their error, with their weights alone."""
    model = finite_hmm(*TWO_STATES).compile()
    ys = [0, 2, 2, 0, 1]
    exact = forward_backward(*TWO_STATES, ys)[0]
    found = poseppl.infer(model, {"y": ys}, hidden_markov_filter, jax.random.key(0))["summary/k_probability"]
    assert found.dims == ("frame", "k_value") and found["k_value"].values.tolist() == [0, 1]
    np.testing.assert_allclose(found, exact, rtol=1e-4)
    number = 4000
    particles = poseppl.infer(model, {"y": ys}, poseppl.particle_filter(model, number), jax.random.key(0))
    error = 5 * np.sqrt(exact * (1 - exact) / number * 4)  # weights and resampling at most quadruple the variance
    assert (abs(particles["summary/k_probability"] - exact) < error).all()


def test_probabilities_count_by_weight():
    model = finite_hmm().compile()
    told = summary_of_sites(model, {}, jnp.array([[0.0], [1.0], [1.0], [0.0]]), jnp.array([0.5, 0.3, 0.0, 0.2]))
    np.testing.assert_allclose(told["k_probability"], [0.7, 0.3], rtol=1e-6)
    alike = summary_of_sites(model, {}, jnp.array([[0.0], [1.0], [1.0], [1.0]]), None)
    np.testing.assert_allclose(alike["k_probability"], [0.25, 0.75], rtol=1e-6)
