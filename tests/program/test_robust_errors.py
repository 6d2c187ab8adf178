"""Robust errors against Student's t, numerical integrals and the curvature of the paper's formula."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
import scipy.integrate
import scipy.stats
from precision import precision
from programs import model

from poseppl.checks import RangeError
from poseppl.program import Leclerc, Lorentzian, WhitenedJacobian

X = jnp.array([0.4, -0.3, 1.1])
COVARIANCE = jnp.array([[2.0, 0.6], [0.6, 0.5]])
POINTS = np.array([[0.3, -0.2], [4.0, 1.0], [-9.0, 2.0]])


@pytest.mark.parametrize("strength", [1.5, 4.0, 30.0])
def test_a_lorentzian_is_a_students_t(strength):
    """Student's t with nu - 1 degrees of freedom and the scale sigma sqrt(nu / (nu - 1))."""
    values = jnp.linspace(-30.0, 30.0, 41)
    student = dist.StudentT(strength - 1, 0.5, 2.0 * np.sqrt(strength / (strength - 1)))
    found = Lorentzian(dist.Normal(0.5, 2.0), strength).log_prob(values)
    np.testing.assert_allclose(found, student.log_prob(values), rtol=1e-5)
    wrong = dist.StudentT(strength - 1, 0.5, 2.0)  # the central peak's width taken for Student's scale
    assert np.abs(found - wrong.log_prob(values)).max() > 0.01


@pytest.mark.full
def test_vectors_have_one_squared_error():
    """A multivariate t; n entries by themselves would be n Student's t."""
    errors = Lorentzian(dist.MultivariateNormal(jnp.ones(2), COVARIANCE), 5.0)
    exact = scipy.stats.multivariate_t(np.ones(2), np.asarray(COVARIANCE) * 5 / 3, df=3)
    np.testing.assert_allclose(errors.log_prob(jnp.asarray(POINTS)), exact.logpdf(POINTS), rtol=1e-5)
    vector = Lorentzian(dist.Normal(jnp.ones(2), 3.0).to_event(1), 5.0)
    single = Lorentzian(dist.Normal(jnp.ones(2), 3.0), 5.0)
    exact = scipy.stats.multivariate_t(np.ones(2), 9 * np.eye(2) * 5 / 3, df=3)
    np.testing.assert_allclose(vector.log_prob(jnp.asarray(POINTS)), exact.logpdf(POINTS), rtol=1e-5)
    assert (vector.batch_shape, single.batch_shape) == ((), (2,))
    assert np.abs(single.log_prob(jnp.asarray(POINTS)).sum(1) - exact.logpdf(POINTS)).max() > 0.1


@pytest.mark.parametrize("strength", [0.5, 6.0, 60.0, 250.0])
def test_leclercs_window_makes_it_a_density(strength):
    """Over a square window of 100 standard deviations a side, in which the peak lies."""
    side, scale = 100.0 * 0.7, 0.7
    errors = Leclerc(dist.Normal(jnp.zeros(2), scale).to_event(1), strength, window=side**2)
    radii = np.linspace(0.0, 49.0 * scale, 20001)
    along = jnp.stack([jnp.asarray(radii), jnp.zeros(len(radii))], -1)
    density = np.exp(np.asarray(errors.log_prob(along), float))
    floor = np.exp(float(errors.log_prob(jnp.array([1e6, 0.0]))))
    integral = scipy.integrate.trapezoid((density - floor) * 2 * np.pi * radii, radii) + floor * side**2
    assert integral == pytest.approx(1.0, abs=1e-3)
    gaussian = np.exp(np.asarray(dist.Normal(jnp.zeros(2), scale).to_event(1).log_prob(along[:1])))
    assert density[0] < gaussian  # some of the mass is the outliers'


@pytest.mark.full
def test_leclercs_without_a_window_is_a_factor():
    """The posterior is the same, up to a constant; it declares to predictive checks that it predicts nothing."""
    gaussian = dist.Normal(jnp.zeros(2), 0.7).to_event(1)
    factor, density = Leclerc(gaussian, 6.0), Leclerc(gaussian, 6.0, window=400.0)
    difference = factor.log_prob(jnp.asarray(POINTS)) - density.log_prob(jnp.asarray(POINTS))
    np.testing.assert_allclose(difference, difference[0], rtol=1e-5)
    assert factor.log_prob(jnp.zeros(2)) == 0.0
    assert not factor.is_predictive


@pytest.mark.full
@pytest.mark.parametrize("family", [Lorentzian, Leclerc])
@pytest.mark.parametrize("gaussian", [dist.Normal(1.0, 2.0), dist.MultivariateNormal(jnp.ones(2), COVARIANCE)])
def test_draws_have_the_densitys_squared_errors(family, gaussian):
    """Kolmogorov's distance from the integral of the density over radii; the Gaussian's own draws are farther."""
    errors, count = family(gaussian, 6.0), 4000
    key, other = jax.random.split(jax.random.key(0))

    def radii_of(distribution, key):
        return np.sqrt((np.asarray(errors.whitened_residual(distribution.sample(key, (count,)))) ** 2).sum(-1))

    grid = np.linspace(0.0, 60.0, 60001)
    floor = 0.0 if family is Lorentzian else np.exp(-3.0)
    cdf = np.cumsum(grid ** (errors.size - 1) * (np.exp(-0.5 * np.asarray(errors.potential(grid**2), float)) - floor))
    exact = lambda r: np.interp(r, grid, cdf / cdf[-1])  # noqa: E731
    assert scipy.stats.kstest(radii_of(errors, key), exact).pvalue > 1e-3
    assert scipy.stats.kstest(radii_of(gaussian, other), exact).pvalue < 1e-3


def test_moments_of_a_lorentzian():
    errors = Lorentzian(dist.Normal(jnp.ones(2), 3.0).to_event(1), jnp.array(8.0))
    draws = np.asarray(errors.sample(jax.random.key(1), (100_000,)), float)
    np.testing.assert_allclose(errors.mean, 1.0)
    assert np.abs(draws.var(0) / errors.variance - 1).max() < 5 * np.sqrt(((draws - 1) ** 4).mean() / 100_000) / 18.0
    assert np.isinf(Lorentzian(dist.Normal(0.0, 1.0), 2.5).variance)


@pytest.mark.full
@pytest.mark.parametrize("family", [Lorentzian, Leclerc])
def test_derivatives_are_those_of_the_potential(family):
    errors, squared = family(dist.Normal(0.0, 1.0), 5.0), jnp.linspace(0.0, 20.0, 21)
    first = jax.vmap(jax.grad(errors.potential))(squared)
    second = jax.vmap(jax.grad(jax.grad(errors.potential)))(squared)
    np.testing.assert_allclose(errors.derivatives(squared)[0], first, rtol=1e-4)
    np.testing.assert_allclose(errors.derivatives(squared)[1], second, rtol=1e-4)
    assert errors.potential(jnp.zeros(())) == 0.0 and errors.derivatives(jnp.zeros(()))[0] == 1.0


MATRIX = jnp.array([[1.0, 0.2, 0.0], [0.3, -1.0, 0.5], [0.0, 0.4, 2.0], [1.0, 1.0, 1.0]])


def linear(state):
    return jnp.concatenate([state["level"][None], state["slope"]]) @ MATRIX.T


def programs_of(family):
    def vectors(params, state, inputs):
        numpyro.sample("y", family(dist.Normal(linear(state).reshape(2, 2), 0.5).to_event(1), 6.0))

    def full(params, state, inputs):
        numpyro.sample("y", family(dist.MultivariateNormal(linear(state).reshape(2, 2), COVARIANCE), 6.0))

    def single(params, state, inputs):
        numpyro.sample("y", family(dist.Normal(linear(state).reshape(2, 2), 0.5), 6.0).to_event(1))

    return {"vectors": vectors, "full": full, "single": single}


@pytest.mark.full
@pytest.mark.parametrize("family", [Lorentzian, Leclerc])
@pytest.mark.parametrize("which", ["vectors", "full", "single"])
def test_curvature_is_the_hessian_of_linear_residuals(family, which):
    """Exactly, the second-order term counted, while errors are no outliers; without it the peak would seem sharper."""
    with precision(np.float64):
        compiled = model(observation=programs_of(family)[which]).compile()
        x = jnp.array([0.4, -0.3, 1.1])
        data = compiled.observe({"y": np.asarray(linear(compiled.to_sites(x))).reshape(2, 2) + 0.3})
        found = jax.jit(compiled.observation_information)(x, data)
        hessian = -jax.hessian(compiled.log_observation)(x, data)
        np.testing.assert_allclose(found, hessian, rtol=1e-6, atol=1e-9)
        centred = compiled.observe({"y": np.asarray(linear(compiled.to_sites(x))).reshape(2, 2)})
        assert np.abs(compiled.observation_information(x, centred) - hessian).max() > 0.01


@pytest.mark.full
@pytest.mark.parametrize("family", [Lorentzian, Leclerc])
def test_outliers_leave_the_curvature_positive(family):
    """Along the residual nothing, across it less than an inlier would give; masked vectors give nothing."""
    compiled = model(observation=programs_of(family)["vectors"]).compile()
    data = np.asarray(linear(compiled.to_sites(X))).reshape(2, 2) + np.array([[9.0, 0.0], [np.nan, np.nan]])
    found = np.asarray(jax.jit(compiled.observation_information)(X, compiled.observe({"y": data})))
    weight = float(family(dist.Normal(0.0, 1.0), 6.0).derivatives(jnp.asarray(18.0**2))[0])
    np.testing.assert_allclose(found, weight * np.outer(MATRIX[1], MATRIX[1]) / 0.25, rtol=1e-3, atol=1e-7)


@pytest.mark.full
@pytest.mark.parametrize("family", [Lorentzian, Leclerc])
def test_the_majorised_curvature_is_of_a_quadratic_above(family):
    """The negative log-density of linear residuals lies below it everywhere, and not below the Gauss-Newton curvature's."""
    with precision(np.float64):
        compiled = model(observation=programs_of(family)["full"]).compile()
        rng = np.random.default_rng(0)
        data = compiled.observe({"y": rng.normal(size=(2, 2)) * 6.0})
        xs = jnp.asarray(rng.normal(size=(200, 3)) * 5.0)
        here = xs[0]
        slope = jax.grad(compiled.log_observation)(here, data)

        def above(curvature):
            """How far the quadratic is above, the linear term of the log-density taken away from both."""
            away = xs - here
            quadratic = 0.5 * jnp.einsum("ni,ij,nj->n", away, curvature, away)
            fall = (
                compiled.log_observation(here, data) + away @ slope - jax.vmap(lambda x: compiled.log_observation(x, data))(xs)
            )
            return np.asarray(quadratic - fall)

        assert above(compiled.observation_information(here, data, majorised=True)).min() > -1e-9
        assert above(compiled.observation_information(here, data)).min() < -0.1


@pytest.mark.full
@pytest.mark.parametrize("family", [Lorentzian, Leclerc])
@pytest.mark.parametrize("which", ["vectors", "full", "single"])
def test_the_expected_curvature_is_that_of_a_state_without_spread_and_smaller_with_one(family, which):
    """If the data are exact, the weight is that of states that are off by the whole standard deviation."""
    with precision(np.float64):
        compiled = model(observation=programs_of(family)[which]).compile()
        x, aside = jnp.array([0.4, -0.3, 1.1]), jnp.array([0.2, 0.1, -0.3])
        exact = np.asarray(linear(compiled.to_sites(x))).reshape(2, 2)
        for error in (0.0, 0.3, np.array([[9.0, 0.0], [np.nan, np.nan]])):
            data = compiled.observe({"y": exact + error})
            found = compiled.observation_information(x, data, spread=jnp.zeros((3, 3)))
            np.testing.assert_allclose(found, compiled.observation_information(x, data), rtol=1e-6, atol=1e-9)
        data = compiled.observe({"y": exact})
        found = compiled.observation_information(x, data, spread=jnp.outer(aside, aside))
        np.testing.assert_allclose(found, compiled.observation_information(x + aside, data), rtol=1e-6, atol=1e-9)
        assert np.trace(found) < np.trace(compiled.observation_information(x, data))


class Known(dist.Normal):
    """The linear residuals, with their derivative in closed form."""

    asked = 0

    def __init__(self, state):
        self.state, self.fixed = state, MATRIX
        super().__init__((MATRIX @ state).reshape(2, 2), 0.5)

    def whitened_jacobian(self, mask):
        Known.asked += 1
        return MATRIX / 0.5 if mask is None else jnp.where(jnp.ravel(mask)[:, None], MATRIX / 0.5, 0.0)


@pytest.mark.full
def test_a_gaussian_that_knows_its_jacobian_is_asked_for_it():
    def known(params, state, inputs):
        numpyro.sample("y", Lorentzian(Known(jnp.concatenate([state["level"][None], state["slope"]])).to_event(1), 6.0))

    assert isinstance(Known(X), WhitenedJacobian)
    data, found = {"y": np.array([[0.3, 1.0], [np.nan, np.nan]])}, []
    for program in (programs_of(Lorentzian)["vectors"], known):
        compiled = model(observation=program).compile()
        found.append(compiled.observation_information(X, compiled.observe(data)))
    assert Known.asked > 0
    np.testing.assert_allclose(found[0], found[1], rtol=1e-5)


@pytest.mark.full
def test_strengths_without_an_integral_are_refused():
    with pytest.raises(RangeError, match="strength is 2.0. Expected more than 2.0"):
        Lorentzian(dist.Normal(jnp.zeros(2), 1.0).to_event(1), 2.0)
    with pytest.raises(RangeError, match="strength is 0.0"):
        Leclerc(dist.Normal(0.0, 1.0), 0.0)
    with pytest.raises(ValueError, match="gaussian is a Laplace"):
        Lorentzian(dist.Laplace(0.0, 1.0), 3.0)
