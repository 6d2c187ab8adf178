"""Maximum likelihood and MAP: published and independent optima, standard errors of second differences, and verdicts."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from fit_problems import (
    PRIOR,
    WALK,
    YS,
    chain_likelihood,
    chain_model,
    hessian,
    nile_model,
    walk_likelihood,
)
from scipy.optimize import minimize, minimize_scalar

import poseppl
from benchmarks.peers import job_nile
from poseppl.errors import InputError
from poseppl.filters import hidden_markov_filter
from poseppl.fitting.optimum import optimum
from poseppl.fitting.problem import MAX_FORWARD, Problem, second_derivatives, slope
from poseppl.fitting.results import delta_method, fit_tree, to_params
from poseppl.gaussians.gaussian import triangular
from poseppl.program.parameters import parameter_bijector

KEY = jax.random.key(0)


class Known(Problem):
    """A problem whose log-likelihood is a given function of u, so that nothing large is compiled."""

    __slots__ = ()
    function = staticmethod(lambda u: 0.0)

    def log_likelihood(self, u, rng_key=None):
        return type(self).function(u)


def problem_of(function, *priors):
    def parameters():
        for number, prior in enumerate(priors):
            numpyro.sample(f"p{number}", prior)

    model = poseppl.StateSpaceModel(WALK.programs.initial, WALK.programs.transition, observed, parameters).compile()
    kind = type("Kind", (Known,), {"function": staticmethod(function), "__slots__": ()})
    return kind(model, parameter_bijector(model), poseppl.kalman_filter, model.observe({"y": YS}), None, KEY, None)


def observed(params, state, inputs):
    numpyro.sample("y", dist.Normal(state["x"], 1.0))


REAL, POSITIVE = dist.Normal(0.0, 2.0), dist.LogNormal(0.0, 1.0)


def found_by(function, *priors, penalised=False, **settings):
    with jax.enable_x64(True):
        problem = problem_of(function, *priors)
        return problem, optimum(problem, KEY, None, penalised=penalised, **settings)


def test_the_covariance_is_the_inverse_information():
    """A quadratic with unequal scales and a strong correlation."""
    precision = np.array([[4.0, 1e3], [1e3, 1e6]]) * [[1.0, 0.9], [0.9, 1.0]]
    centre = np.array([1.0, -0.002])
    problem, found = found_by(lambda u: -0.5 * (u - centre) @ jnp.asarray(precision) @ (u - centre), REAL, POSITIVE)
    np.testing.assert_allclose(found.unconstrained, centre, rtol=1e-4)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(precision), rtol=1e-6)
    assert found.attrs["converged"] and not found.findings
    draws = found.draws[0]
    assert np.abs(np.cov(draws.T) / np.linalg.inv(precision) - 1).max() < 0.25


def test_rounded_gradients_are_not_differenced():
    """A program that computes in float32: differences of its gradients would be off by 1e-4."""

    def rounded(u):
        return -0.5 * jnp.sum((u.astype(jnp.float32) - np.float32(1.2345)) ** 2).astype(u.dtype)

    _, found = found_by(rounded, REAL, REAL)
    np.testing.assert_allclose(found.covariance, np.eye(2), atol=1e-6)


@pytest.mark.parametrize("size", [2, MAX_FORWARD + 1])
def test_the_slope_is_value_and_gradient(size):
    u = jnp.linspace(-1.0, 1.0, size)
    value, gradient = slope(lambda u: jnp.sum(u**3))(u)
    assert value.shape == () and float(value) == pytest.approx(0.0, abs=1e-5)
    np.testing.assert_allclose(gradient, 3 * u**2, rtol=1e-6)


def test_second_derivatives_where_states_have_no_noise():
    """A scan whose root is singular: its first entry is s^2 after two steps."""

    def entry(s):
        start = jnp.diag(jnp.array([1.0, 0.0]))
        return jax.lax.scan(lambda root, _: (triangular(root * s[0]), None), start, None, 2)[0].sum()

    np.testing.assert_allclose(second_derivatives(entry)(jnp.array([0.3])), [[2.0]], rtol=1e-5)


def test_standard_errors_are_by_the_delta_method():
    """Standard errors of exp(u), and of shares, whose coordinates are fewer than their entries."""
    with jax.enable_x64(True):
        problem = problem_of(lambda u: 0.0, POSITIVE, dist.Dirichlet(jnp.ones(3)))
        u, covariance = np.array([0.3, -0.2, 0.7]), np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.02], [0.0, 0.02, 0.05]])
        values, jacobians, drawn = to_params(problem.model, u, u[None, None])
        errors = delta_method(jacobians, covariance)
        rows = np.stack(
            [
                (np.asarray(problem.bijector.to_params(u + step)["p1"]) - problem.bijector.to_params(u - step)["p1"]) / 2e-6
                for step in 1e-6 * np.eye(3)
            ],
            1,
        )
        np.testing.assert_allclose(errors["p0"], np.exp(0.3) * 0.2, rtol=1e-9)
        np.testing.assert_allclose(errors["p1"], np.sqrt(np.diagonal(rows @ covariance @ rows.T)), rtol=1e-6)
        np.testing.assert_allclose(values["p1"].sum(), 1.0)
        np.testing.assert_allclose(drawn["p1"][0, 0], values["p1"], rtol=1e-12)
        unknown = np.full((3, 3), np.nan)
        unknown[0, 0] = 0.04
        errors = delta_method(jacobians, unknown)
    assert np.isfinite(errors["p0"]) and np.isnan(errors["p1"]).all()


def test_map_adds_the_prior_of_the_constrained_params():
    """The mode of a LogNormal is at exp(-1), that of its logarithm at 0."""
    _, found = found_by(lambda u: 0.0 * u[0], POSITIVE, penalised=True)
    assert found.unconstrained[0] == pytest.approx(-1.0, abs=1e-5)
    assert found.attrs["log_likelihood"] == pytest.approx(0.0, abs=1e-12)


def texts(found):
    return [str(each) for each in found.findings]


@pytest.mark.full
def test_an_estimate_at_a_bound_has_no_standard_error():
    problem, found = found_by(lambda u: -jnp.exp(u[0]) - 0.5 * (u[1] - 1.0) ** 2, POSITIVE, REAL)
    assert "The estimate of p0 is at its bound (towards" in texts(found)[0] and len(found.findings) == 1
    tree = fit_tree(problem, found, "ml", list(found.findings))
    assert np.isnan(tree["estimate/p0_se"]) and tree["estimate/p1_se"] == pytest.approx(1.0)
    assert np.isnan(tree["posterior/p0"]).all() and np.isfinite(tree["posterior/p1"]).all()
    assert "at its bound" in str(poseppl.findings_of_fit(tree)[0])
    with pytest.raises(InputError, match="there is no draw"):
        poseppl.fitted_params(tree, 1000)


@pytest.mark.parametrize(
    ("function", "match"),
    [
        (lambda u: -0.5 * (u[0] - 1.0) ** 2 + 0.0 * u[1], "do not identify p1"),
        (lambda u: -0.5 * (u[0] + u[1] - 1.0) ** 2, "do not identify the combination of p0, p1"),
    ],
)
def test_what_the_data_do_not_identify_is_reported(function, match):
    _, found = found_by(function, REAL, REAL)
    assert any(match in each and each.startswith("error") for each in texts(found))
    assert np.isnan(np.diagonal(found.covariance)).any()


@pytest.mark.full
def test_a_search_that_does_not_converge_is_reported():
    valley = lambda u: -100.0 * (u[1] - u[0] ** 2) ** 2 - (1.0 - u[0]) ** 2  # noqa: E731
    _, found = found_by(valley, REAL, REAL, max_steps=3)
    assert not found.attrs["converged"] and any("did not converge" in each and "max_steps" in each for each in texts(found))
    _, found = found_by(valley, REAL, REAL)
    assert found.attrs["converged"]
    np.testing.assert_allclose(found.unconstrained, 1.0, atol=1e-3)


def test_other_optima_are_reported():
    double = lambda u: jnp.logaddexp(-8.0 * (u[0] + 1.0) ** 2, 2.0 - 8.0 * (u[0] - 1.0) ** 2)  # noqa: E731
    _, found = found_by(double, REAL, num_starts=12)
    assert found.unconstrained[0] == pytest.approx(1.0, abs=1e-2)
    assert any("ended at a lower optimum" in each for each in texts(found))


def test_filters_and_settings_that_do_not_fit_are_refused():
    data = {"y": YS}
    for filter, settings, match in (
        (None, {}, "filter: method 'ml' was given none .expected a builder"),
        (
            poseppl.kalman_filter,
            {"num_chains": 3},
            "settings: method 'ml' has no setting 'num_chains' .expected num_starts, max",
        ),
        (poseppl.kalman_filter, {"method": "iterated-filtering"}, "filter: method 'iterated-filtering' was given one"),
        (lambda model: poseppl.particle_filter(model, 10), {}, "filter: its likelihood is no smooth function"),
        (poseppl.kalman_filter, {"start": {"noise": -1.0}}, "start: noise is -1.0"),
    ):
        with pytest.raises(InputError, match=match):
            poseppl.fit(WALK, data, filter, **settings)
    with pytest.raises(ValueError, match="method is 'mle'. Expected one of ml, map"):
        poseppl.fit(WALK, data, poseppl.kalman_filter, method="mle")


@pytest.mark.full
@pytest.mark.parametrize("method", ["ml", "map"])
def test_the_walks_optimum_with_a_missing_datum(method, tmp_path, caplog):
    """Another optimiser on another likelihood; the fit goes on into infer, and comes back from its file."""
    prior = lambda u: -u - 0.5 * ((u - PRIOR[0]) / PRIOR[1]) ** 2 if method == "map" else 0.0  # noqa: E731
    loss = lambda u: -walk_likelihood(u) - prior(u)  # noqa: E731
    wanted = minimize_scalar(loss, bounds=(-4, 2), method="bounded", options={"xatol": 1e-9})
    fitted = poseppl.fit(WALK, {"y": YS}, poseppl.kalman_filter, method=method)
    assert not caplog.records
    u = float(fitted["unconstrained_estimate/params"].item())
    assert u == pytest.approx(wanted.x, abs=1e-5)
    curvature = hessian(lambda u: loss(u[0]), np.array([wanted.x]), 1e-4)[0, 0]
    assert fitted["estimate/noise_se"].item() == pytest.approx(np.exp(wanted.x) / np.sqrt(curvature), rel=1e-3)
    poseppl.save_result(fitted, tmp_path / "fit.nc")
    read = poseppl.load_fit(tmp_path / "fit.nc")
    result = poseppl.infer(WALK, {"y": YS}, poseppl.kalman_filter, KEY, params=read)
    assert float(result["sample_stats/log_evidence"].sum()) == pytest.approx(walk_likelihood(u), abs=1e-3)
    with pytest.raises(InputError, match="not a result of poseppl"):
        poseppl.load_result(tmp_path / "fit.nc")
    poseppl.save_result(result, tmp_path / "result.nc")
    with pytest.raises(InputError, match="but no fit of poseppl"):
        poseppl.load_fit(tmp_path / "result.nc")


@pytest.mark.full
def test_the_flow_of_the_nile():
    """The published variances are 15099 and 1469.1 (Durbin and Koopman 2012, section 2.10)."""
    fitted = poseppl.fit(nile_model(), {"flow": job_nile.FLOW}, poseppl.kalman_filter, num_starts=2)
    assert fitted["estimate/noise_variance"].item() == pytest.approx(15099, abs=2)
    assert fitted["estimate/step_variance"].item() == pytest.approx(1469.1, abs=2)
    u = fitted["unconstrained_estimate/params"].values
    covariance = np.linalg.inv(-hessian(lambda u: job_nile.log_likelihood(u, job_nile.FLOW), u, 1e-3))
    np.testing.assert_allclose(fitted["unconstrained_estimate/covariance"], covariance, rtol=1e-3)
    value = job_nile.log_likelihood(u, job_nile.FLOW)
    assert float(fitted.attrs["log_likelihood"]) == pytest.approx(value, abs=1e-7)
    assert not poseppl.findings_of_fit(fitted)


@pytest.mark.full
def test_a_chain_of_two_states_with_gaps():
    """Integer states; the optimum of another likelihood by another optimiser, from the same start."""
    rng = np.random.default_rng(3)
    busy = (rng.random(60).cumsum() // 4 % 2).astype(int)
    ys = np.where(rng.random(60) < 0.1, np.nan, np.array([-1.0, 1.5])[busy] + 0.7 * rng.normal(size=60))
    start = {"stay": np.array([0.8, 0.7]), "means": np.array([-0.8, 1.2])}
    fitted = poseppl.fit(chain_model(), {"y": ys}, hidden_markov_filter, start=start)
    loss = lambda u: -chain_likelihood(1 / (1 + np.exp(-u[:2])), u[2:], ys)  # noqa: E731
    wanted = minimize(loss, [1.4, 0.8, -0.8, 1.2], method="BFGS", options={"gtol": 1e-7}).x
    np.testing.assert_allclose(fitted["unconstrained_estimate/params"], wanted, atol=1e-3)
    covariance = np.linalg.inv(hessian(loss, wanted, 1e-3))
    np.testing.assert_allclose(fitted["unconstrained_estimate/covariance"], covariance, rtol=1e-2, atol=1e-4)
