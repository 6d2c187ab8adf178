"""Posterior draws and simulated likelihoods against the exact posterior of a walk's noise, and of counts."""

from __future__ import annotations

import warnings

import jax
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from fit_problems import WALK, YS, walk_likelihood, walk_posterior
from scipy.optimize import minimize_scalar

import poseppl
from poseppl.fitting.iterated_filtering import _of_swarms
from poseppl.fitting.sampling import _of_guide
from poseppl.fitting.smc_squared import _of_moves

DATA = {"y": YS}


def few(model):
    return poseppl.particle_filter(model, 30)


def fit(method, filter=None, **settings):
    return poseppl.fit(WALK, DATA, filter, jax.random.key(3), method=method, **settings)


def check_moments(fitted, least_ess):
    """Mean and variance of the log of the noise, within five Monte Carlo errors for so many effective draws."""
    draws = np.log(fitted["posterior/noise"].values).ravel()
    mean, variance, _ = walk_posterior()
    assert abs(draws.mean() - mean) < 5 * np.sqrt(variance / least_ess)
    assert abs(draws.var() / variance - 1) < 5 * np.sqrt(4 / least_ess)  # of a kurtosis of up to 5


@pytest.mark.full
def test_nuts_has_the_posterior_of_the_grid_and_arviz_reads_it():
    with warnings.catch_warnings(action="ignore"):
        import arviz as az
    fitted = fit("nuts", poseppl.kalman_filter, num_draws=400, num_warmup=200)
    tree = poseppl.to_arviz(fitted)
    ess = float(az.ess(tree, var_names=["noise"])["noise"])
    assert ess > 300 and float(az.summary(tree, var_names=["noise"])["r_hat"].iloc[0]) < 1.03
    check_moments(fitted, ess)
    assert fitted["sample_stats/diverging"].shape == (4, 400)


@pytest.mark.slow
def test_pmmh_and_particle_gibbs_have_it():
    check_moments(fit("pmmh", few, num_draws=1500, num_warmup=300), 200)
    check_moments(fit("particle-gibbs", num_particles=20, num_draws=600, num_warmup=150), 200)


@pytest.mark.full
@pytest.mark.parametrize("guide", ["full-rank", pytest.param("mean-field", marks=pytest.mark.slow)])
def test_svi_is_near_it(guide):
    """One coordinate: both guides are the best Gaussian, whose mean and variance are near."""
    fitted = fit("svi", poseppl.kalman_filter, guide=guide, num_steps=600)
    draws = np.log(fitted["posterior/noise"].values).ravel()
    mean, variance, _ = walk_posterior()
    assert abs(draws.mean() - mean) < 0.2 * np.sqrt(variance)
    assert abs(draws.std() / np.sqrt(variance) - 1) < 0.2


@pytest.mark.slow
def test_smc_squared_has_it_and_the_evidence_of_the_model():
    fitted = fit("smc2", few, num_params=400)
    check_moments(fitted, 100)
    found = [float(fitted.attrs["log_evidence"]), *(fit_evidence(seed) for seed in range(3))]
    error = np.std(found, ddof=1) / 2
    assert abs(np.mean(found) - walk_posterior()[2]) < 5 * max(error, 0.03)


def fit_evidence(seed):
    fitted = poseppl.fit(WALK, DATA, few, jax.random.key(seed), method="smc2", num_params=200)
    return float(fitted.attrs["log_evidence"])


@pytest.mark.full
def test_iterated_filtering_comes_to_the_maximum():
    """From where it is not: the noise is 0.7, and a swarm that is not selected stays."""
    settings = {"num_particles": 400, "num_passes": 30, "num_starts": 2, "perturbation": 0.2}
    fitted = fit("iterated-filtering", start={"noise": 3.0}, **settings)
    u = float(np.log(fitted["estimate/noise"].item()))
    best = minimize_scalar(lambda u: -walk_likelihood(u), bounds=(-4, 2), method="bounded")
    assert walk_likelihood(u) > -best.fun - 0.2
    error = fitted["estimate/noise_se"].item() / np.exp(u)
    curvature = -(walk_likelihood(best.x + 1e-3) - 2 * walk_likelihood(best.x) + walk_likelihood(best.x - 1e-3)) / 1e-6
    assert error == pytest.approx(1 / np.sqrt(curvature), rel=0.4)


@pytest.mark.full
def test_counts_of_integer_states():
    """A population that follows without noise of its own, seen through Poisson counts: the rate has a conjugate posterior."""

    def parameters():
        numpyro.sample("rate", dist.Gamma(30.0, 15.0))

    def initial(params, inputs):
        numpyro.sample("age", dist.DiscreteUniform(0, 1))

    def transition(params, state, inputs):
        numpyro.sample("age", dist.DiscreteUniform(0, 1))
        numpyro.deterministic("twice", 2 * state["age"])

    def observation(params, state, inputs):
        numpyro.sample("count", dist.Poisson(params["rate"]))

    counts = np.array([2, 5, 3, 4, 1, 6, 3, 2])
    model = poseppl.StateSpaceModel(initial, transition, observation, parameters).compile()
    fitted = poseppl.fit(model, {"count": counts}, few, method="smc2", num_params=300)
    draws = fitted["posterior/rate"].values.ravel()
    shape, precision = 30.0 + counts.sum(), 15.0 + len(counts)
    assert abs(draws.mean() - shape / precision) < 5 * np.sqrt(shape) / precision / np.sqrt(75)
    climbed = poseppl.fit(model, {"count": counts}, method="iterated-filtering", perturbation=0.5)
    assert climbed["estimate/rate"].item() == pytest.approx(counts.mean(), rel=0.1)
    assert climbed["estimate/rate_se"].item() == pytest.approx(np.sqrt(counts.mean() / len(counts)), rel=0.1)


def test_verdicts_of_methods():
    rng = np.random.default_rng(0)
    flat = rng.normal(size=1000)
    assert not list(_of_guide(flat, 0.3, "full-rank"))
    assert "still rises" in str(next(_of_guide(flat + np.arange(1000), 0.3, "full-rank")))
    assert "guide='full-rank'" in str(next(_of_guide(flat, 0.9, "mean-field")))
    swarm = {"log_likelihood": -10.0, "log_likelihood_error": 0.1}
    level = np.tile(rng.normal(size=(40, 1)), 2)
    assert not list(_of_swarms(level, [swarm, swarm], 0))
    lower = swarm | {"log_likelihood": -20.0}
    assert "1 of 2 swarms ended at a lower" in str(next(_of_swarms(level, [swarm, lower], 0)))
    assert "still rises" in str(next(_of_swarms(level + 3.0 * np.arange(40)[:, None], [swarm, swarm], 0)))
    assert not list(_of_moves([-1.0], [0.3], 90, 100))
    assert "5 of 100 are distinct" in str(next(_of_moves([-1.0], [0.3], 5, 100)))
    assert "frame 1 are impossible" in str(next(_of_moves([-1.0, -np.inf], [0.3], 90, 100)))
