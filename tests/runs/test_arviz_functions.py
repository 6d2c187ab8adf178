"""ArviZ's functions on what `infer` returns: by ArviZ 1 directly, by earlier versions through `to_arviz`."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import jax
import matplotlib as mpl
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

import poseppl
from poseppl.kernels.hmc import HMCSettings

mpl.use("Agg")
with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import arviz as az
    import matplotlib.pyplot as plt

pytestmark = [pytest.mark.full, pytest.mark.quick, pytest.mark.filterwarnings("ignore")]
CLASSIC = int(version("arviz").partition(".")[0]) < 1
FIRST: dict[str, Any] = {"var_names": ["level"], "coords": {"frame": [0, 1]}}


def initial(params, inputs):
    numpyro.sample("level", dist.Normal(0.0, 1.0))


def transition(params, state, inputs):
    numpyro.sample("level", dist.Normal(0.9 * state["level"], 0.5))


def observation(params, state, inputs):
    numpyro.sample("height", dist.Normal(state["level"], 0.3))


@pytest.fixture(scope="module")
def result():
    model = poseppl.StateSpaceModel(initial, transition, observation).compile()
    data = {"height": np.array([0.1, 0.4, -0.2, 0.3])}
    settings = HMCSettings(num_updates=60, num_leapfrog=4, num_warmup=10)
    found = poseppl.infer(model, data, poseppl.hmc_filter(model, 4, settings), jax.random.key(0))
    return poseppl.add_predictive(found, model, jax.random.key(1))


FUNCTIONS: dict[str, tuple[str, Callable[..., Any]]] = {
    "summary": ("summary", lambda function, data: function(data, var_names=["level"])),
    "trace": ("plot_trace", lambda function, data: function(data, **FIRST)),
    "trace and density": ("plot_trace" if CLASSIC else "plot_trace_dist", lambda function, data: function(data, **FIRST)),
    "autocorrelation": ("plot_autocorr", lambda function, data: function(data, **FIRST)),
    "ESS": ("plot_ess", lambda function, data: function(data, **FIRST)),
    "rank": ("plot_rank", lambda function, data: function(data, **FIRST)),
    "loo": ("loo", lambda function, data: function(data)),
    "compare": ("compare", lambda function, data: function({"one": data, "other": data})),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_arviz_takes_what_infer_returns(result, name):
    function, call = FUNCTIONS[name]
    found = call(getattr(az, function), poseppl.to_arviz(result) if CLASSIC else result)
    assert found is not None
    if name == "summary":
        mean = result["posterior/level"].mean(("chain", "draw")).values
        np.testing.assert_allclose(np.asarray(found["mean"], float), mean, atol=0.06)
        assert len(found) == 4
    if name == "loo":
        assert found.n_data_points == 4 and np.isfinite(found.elpd_loo if CLASSIC else found.elpd)
    plt.close("all")


def test_diagnostics_do_not_hinder_arviz(result):
    """A diagnosed result has groups that ArviZ does not know."""
    whole = poseppl.diagnose(result)
    found = az.ess(poseppl.to_arviz(whole) if CLASSIC else whole, var_names=["level"], method="mean")
    values = (found if CLASSIC else found.get("posterior", found))["level"].values
    np.testing.assert_allclose(np.ravel(values), np.ravel(whole["diagnostics/ess"].values), rtol=1e-5)
