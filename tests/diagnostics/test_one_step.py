"""The density of each frame one step ahead, as ArviZ's, against Kalman's, and where az.loo cannot tell models."""

from __future__ import annotations

import warnings

import jax
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from oracles.kalman import kalman_filter as exact_filter
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices

import poseppl
from poseppl.diagnostics import one_step_elpd
from poseppl.errors import InputError
from poseppl.filters import annealed_filter
from poseppl.smoothers import rauch_tung_striebel_smoother

pytestmark = pytest.mark.full

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # ArviZ 0.23 announces its successor
    import arviz as az

DECAY, STEP, NOISE, FRAMES = 0.9, 0.5, 0.1, 120
KEY = jax.random.key(0)


def initial(params, inputs):
    numpyro.sample("x", dist.Normal(0.0, 1.0))


def transition(params, state, inputs):
    numpyro.sample("x", dist.Normal(params["decay"] * state["x"], STEP))


def observation(params, state, inputs):
    numpyro.sample("y", dist.Normal(state["x"], NOISE))


def model_of(decay):
    return poseppl.StateSpaceModel(initial, transition, observation).compile(params={"decay": decay})


def data():
    rng, x, ys = np.random.default_rng(0), 0.0, []
    for t in range(FRAMES):
        x = rng.normal() if t == 0 else DECAY * x + STEP * rng.normal()
        ys.append(x + NOISE * rng.normal())
    return np.where(np.arange(FRAMES) % 10 == 3, np.nan, ys)


YS = data()


def exact(decay):
    matrices = linear_gaussian_matrices(1, A=[[decay]], Q=[[STEP**2]], R=[[NOISE**2]], P=np.eye(1), m=np.zeros(1))
    seen = np.isfinite(YS)
    return exact_filter(matrices, np.nan_to_num(YS)[:, None], seen[:, None]).log_evidence[seen]


def test_it_is_the_density_of_each_frame_and_ranks_models():
    results, found = {}, {}
    for decay in (DECAY, 0.4):
        model = model_of(decay)
        results[decay] = poseppl.infer(model, {"y": YS}, poseppl.kalman_filter, KEY)
        found[decay] = one_step_elpd(results[decay])
        np.testing.assert_allclose(found[decay]["loo_i"], exact(decay), rtol=1e-3, atol=1e-4)
        assert found[decay]["elpd_loo"] == pytest.approx(exact(decay).sum(), rel=1e-4)
    apart = exact(DECAY) - exact(0.4)
    table = az.compare({"wrong": found[0.4], "right": found[DECAY]})
    assert table.index.tolist() == ["right", "wrong"]
    assert table.loc["wrong", "elpd_diff"] == pytest.approx(apart.sum(), rel=1e-3)
    assert table.loc["wrong", "dse"] == pytest.approx(np.sqrt(len(apart) * apart.var()), rel=1e-3)
    # by importance weights each precise datum seems to be predicted by itself
    smoothed = poseppl.smooth(results[DECAY], rauch_tung_striebel_smoother(model_of(DECAY)), KEY)
    whole = poseppl.add_predictive(smoothed, model_of(DECAY), KEY)
    with pytest.warns(UserWarning, match="Pareto"):
        weighted = az.loo(poseppl.to_arviz(whole))
    assert weighted.elpd_loo > exact(DECAY).sum() + 50


def test_many_series_count_together_and_their_ends_do_not():
    batch = poseppl.infer_batch(model_of(DECAY), [{"y": YS[:50]}, {"y": YS}], poseppl.kalman_filter, KEY)
    found, seen = one_step_elpd(batch)["loo_i"], np.isfinite(YS[:50]).sum()
    np.testing.assert_allclose(found, np.concatenate([exact(DECAY)[:seen], exact(DECAY)]), rtol=1e-3, atol=1e-4)


def test_what_has_no_densities_is_refused():
    model = model_of(DECAY)
    seeking = poseppl.infer(model, {"y": YS[:4]}, annealed_filter(model, num_particles=20, num_layers=2), KEY)
    with pytest.raises(InputError, match="no evidence of its frames"):
        one_step_elpd(seeking)
    impossible = poseppl.infer(model, {"y": [0.1, 1e30]}, poseppl.kalman_filter, KEY)
    with pytest.raises(InputError, match="the data of 1 frames are impossible"):
        one_step_elpd(impossible)
    with pytest.raises(InputError, match="observed_data: the result has no data"):
        one_step_elpd(impossible.drop_nodes("observed_data"))
