"""Several transitions between two frames, sites that start again at each, and steps of diffusions, against exact answers."""

from __future__ import annotations

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from oracles.kalman import kalman_filter, rauch_tung_striebel
from poseppl_models.toys.linear_gaussian import LinearGaussian
from precision import precision
from scipy import stats

import poseppl
from poseppl.errors import InputError
from poseppl.program import euler_maruyama, milstein, with_reset, with_substeps
from poseppl.program.diffusion import MilsteinStep
from poseppl.smoothers import rauch_tung_striebel_smoother

KEY = jax.random.key(0)
A = np.array([[0.9, 0.2], [-0.1, 0.8]])
Q = np.array([[0.3, 0.1], [0.1, 0.2]])
DATA = np.random.default_rng(0).normal(0, 1, 6).astype(np.float32)
DATA[2] = np.nan


def linear():
    def initial(params, inputs):
        numpyro.sample("x", dist.MultivariateNormal(jnp.zeros(2), jnp.eye(2)))

    def transition(params, state, inputs):
        numpyro.sample("x", dist.MultivariateNormal(jnp.asarray(A) @ state["x"], jnp.asarray(Q)))

    def observation(params, state, inputs):
        assert set(state) == {"x"}
        numpyro.sample("y", dist.Normal(state["x"][0], 0.5))

    return poseppl.StateSpaceModel(initial, transition, observation)


@pytest.mark.parametrize("dtype", [np.float32, pytest.param(np.float64, marks=pytest.mark.full)])
def test_linear_substeps_are_a_power(dtype):
    number, power = 3, np.linalg.matrix_power
    noise = sum(power(A, j) @ Q @ power(A, j).T for j in range(number))
    observed = np.array([[1.0, 0.0]]), np.array([[0.25]])
    matrices = LinearGaussian(power(A, number), noise, *observed, np.zeros(2), np.eye(2), None)
    exact = kalman_filter(matrices, DATA[:, None], ~np.isnan(DATA)[:, None])
    tolerance = 1e-4 if dtype == np.float32 else 1e-10
    with precision(dtype):
        model = with_substeps(linear(), number).compile()
        result = poseppl.infer(model, {"y": DATA}, poseppl.kalman_filter(model), KEY)
        np.testing.assert_allclose(result["sample_stats/log_evidence"], exact.log_evidence, atol=tolerance)
        smoothed = poseppl.smooth(result, rauch_tung_striebel_smoother(model), KEY)
        tolerance = max(tolerance, 1e-7)  # roots of covariances that may be singular are less exact
        means, covariances = rauch_tung_striebel(matrices, exact)[:2]
        np.testing.assert_allclose(smoothed["summary/x_mean"], means, atol=tolerance)
        sd = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
        np.testing.assert_allclose(smoothed["summary/x_sd"], sd, atol=tolerance)


def epidemic(probability=0.3):
    """Susceptible people of whom each is infected with a probability; `cases` counts those who are."""

    def initial(params, inputs):
        numpyro.sample("susceptible", dist.Delta(jnp.asarray(4)))
        numpyro.sample("cases", dist.Delta(jnp.asarray(7)))
        numpyro.sample("new", dist.Delta(jnp.asarray(0)))

    def transition(params, state, inputs):
        new = numpyro.sample("new", dist.Binomial(state["susceptible"], probability))
        numpyro.sample("susceptible", dist.Delta(state["susceptible"] - new))
        numpyro.sample("cases", dist.Delta(state["cases"] + new))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Poisson(state["cases"] + 0.5))

    return poseppl.StateSpaceModel(initial, transition, observation)


@pytest.mark.full
def test_counts_that_accumulate_are_binomial():
    number = 3
    model = with_reset(with_substeps(epidemic(), number), "cases").compile()
    start = model.sample_initial(KEY)
    # each path of new infections that adds up to some number has a density, and these add up to the binomial
    law = stats.binom(4, 1 - 0.7**number).pmf(np.arange(5))
    paths = [path for path in itertools.product(range(5), repeat=number) if sum(path) <= 4]
    rows = np.array([_flat(model, path) for path in paths], np.float32)
    densities = np.exp(jax.jit(jax.vmap(lambda x: model.log_transition(x, start)))(rows))
    totals = np.bincount(np.sum(paths, 1), densities, 5)
    np.testing.assert_allclose(totals, law, rtol=1e-4)
    drawn = jax.jit(jax.vmap(lambda key: model.to_sites(model.sample_transition(key, start))["cases"]))
    counts = np.bincount(drawn(jax.random.split(KEY, 2000)), minlength=5)
    assert stats.chisquare(counts, 2000 * law).pvalue > 1e-3


def _flat(model, path):
    """The flat state after some new infections in each sub-step; sites within a sub-step are in the order of their names."""
    between, left, cases = [], 4, 0
    for new in path:
        left, cases = left - new, cases + new
        between += [cases, new, left]
    values = {"susceptible": left, "cases": cases, "new": path[-1], "substeps": np.array(between[:-3], np.float32)}
    return model.to_flat(values)


@pytest.mark.full
def test_a_particle_filter_of_accumulated_counts_has_their_evidence():
    model = with_reset(with_substeps(epidemic(), 3), "cases").compile()
    probability = 1 - 0.7**3
    table = np.array([[stats.binom(left, probability).pmf(left - after) for after in range(5)] for left in range(5)])
    y = [7, 2, np.nan, 1]
    state = np.eye(5)[4] * stats.poisson(7.5).pmf(7)
    for value in y[1:]:
        cases = np.arange(5)[:, None] - np.arange(5)
        likelihood = 1.0 if np.isnan(value) else stats.poisson(np.maximum(cases, 0) + 0.5).pmf(value)
        state = state @ (table * likelihood)
    builder = lambda model: poseppl.particle_filter(model, 1000)  # noqa: E731
    runs = [float(poseppl.log_likelihood(model, None, {"y": y}, builder, key)) for key in jax.random.split(KEY, 10)]
    error = np.std(runs, ddof=1) / np.sqrt(len(runs))
    assert abs(np.mean(runs) + np.var(runs) / 2 - np.log(state.sum())) < 4 * error + 1e-4


@pytest.mark.full
def test_a_gradient_that_is_not_known_is_nan():
    def transition(params, state, inputs):
        new = numpyro.sample("new", dist.Poisson(params["rate"]))
        numpyro.sample("level", dist.Delta(0.5 * state["level"] + params["rate"] * new))

    def initial(params, inputs):
        numpyro.sample("new", dist.Poisson(1.0))
        numpyro.sample("level", dist.Delta(1.0))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["level"], 1.0))

    programs = poseppl.StateSpaceModel(initial, transition, observation)

    def value(number):
        model = with_substeps(programs, number).compile(params={"rate": 1.0})
        builder = lambda model: poseppl.particle_filter(model, 50)  # noqa: E731
        return jax.value_and_grad(lambda rate: poseppl.log_likelihood(model, {"rate": rate}, {"y": [0.5, 1.0]}, builder))(1.0)

    assert np.isfinite(value(1)).all()
    found, gradient = value(2)
    assert np.isfinite(found) and np.isnan(gradient)


def test_wrong_numbers_and_sites_are_refused():
    with pytest.raises(InputError, match="at least 1"):
        with_substeps(linear(), 0)
    assert with_substeps(linear(), 1).transition.__name__ == "transition"
    with pytest.raises(InputError, match="no site 'z'"):
        with_reset(linear(), "z").compile()


# Diffusions


def ornstein_uhlenbeck(number):
    """dx = -x dt + dW, in sub-steps of a frame's time."""
    step = euler_maruyama(lambda p, s, i: {"x": -s["x"]}, lambda p, s, i: {"x": 1.0}, lambda inputs: inputs["dt"] / number)

    def initial(params, inputs):
        numpyro.sample("x", dist.Normal(1.0, 0.2))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["x"], 1.0))

    return with_substeps(poseppl.StateSpaceModel(initial, step, observation), number).compile({"dt": 1.0})


@pytest.mark.full
def test_an_euler_scheme_converges_with_its_step_at_any_time():
    for dt in (0.5, 2.0):  # irregular time stamps
        errors = []
        for number in (4, 8):
            model = ornstein_uhlenbeck(number)
            x = model.to_flat({"x": 2.0, "substeps": np.zeros(number - 1, np.float32)})
            mean, covariance = model.transition_moments(x, {"dt": dt})
            factor = 1 - dt / number  # the scheme's own law, exactly
            np.testing.assert_allclose(mean[0], 2 * factor**number, rtol=1e-4)
            np.testing.assert_allclose(
                covariance[0, 0], dt / number * (1 - factor ** (2 * number)) / (1 - factor**2), rtol=1e-4
            )
            errors.append([mean[0] - 2 * np.exp(-dt), covariance[0, 0] - (1 - np.exp(-2 * dt)) / 2])
        # half of the step, half of the error, up to the next order
        np.testing.assert_allclose(np.array(errors[0]) / np.array(errors[1]), 2.0, atol=0.6)


def test_shared_noises_of_a_vector():
    matrix = np.array([[1.0, 0.5], [0.0, 2.0]])
    step = euler_maruyama(lambda p, s, i: {"x": s["x"]}, lambda p, s, i: {"x": jnp.asarray(matrix)}, 0.1)
    programs = poseppl.StateSpaceModel(
        lambda params, inputs: numpyro.sample("x", dist.Normal(0.0, 1.0).expand((2,))),
        step,
        lambda params, state, inputs: numpyro.sample("y", dist.Normal(state["x"][0], 1.0)),
    )
    mean, covariance = programs.compile().transition_moments(jnp.array([1.0, 2.0]))
    np.testing.assert_allclose(mean, [1.1, 2.2], rtol=1e-6)
    np.testing.assert_allclose(covariance, 0.1 * matrix @ matrix.T, rtol=1e-6)


@pytest.mark.parametrize("dtype", [np.float32, pytest.param(np.float64, marks=pytest.mark.full)])
@pytest.mark.parametrize("bend", [0.2, -0.2, 1e-6, 0.0])
def test_the_milstein_density_is_that_of_its_draws(bend, dtype):
    scale = 0.5
    with precision(dtype):
        law = MilsteinStep(dtype(0.3), dtype(scale), dtype(bend))
        grid = np.linspace(-3, 4, 2801)
        density = np.exp(np.asarray(law.log_prob(jnp.asarray(grid)), float))
        draws = np.asarray(law.sample(jax.random.key(1), (4000,)), float)
        mean, variance = float(law.mean), float(law.variance)
    # P(loc + scale z + bend (z^2 - 1) < v), from the roots of the polynomial
    values = np.array([-0.1, 0.1, 0.3, 0.7])  # the density is infinite where the values end, beyond these
    if bend:
        roots = [np.roots([bend, scale, 0.3 - bend - value]) for value in values]
        inside = [np.ptp(stats.norm.cdf(root)) if np.isreal(root).all() else 0.0 for root in roots]
        exact = np.array(inside) if bend > 0 else np.where([np.isreal(root).all() for root in roots], 1 - np.array(inside), 1.0)
    else:
        exact = stats.norm(0.3, scale).cdf(values)
    shares = (draws[:, None] < values).mean(0)
    assert np.all(np.abs(shares - exact) < 4 * np.sqrt(exact * (1 - exact) / 4000) + 1e-9)
    between = [density[(grid > low) & (grid < high)].sum() * 0.0025 for low, high in itertools.pairwise(values)]
    np.testing.assert_allclose(between, np.diff(exact), atol=0.005)
    assert abs(draws.mean() - mean) < 4 * draws.std() / 4000**0.5
    assert draws.var() == pytest.approx(variance, rel=0.15)


def test_a_milstein_step_of_a_geometric_motion():
    sites = {"price": jnp.array([1.0, 2.0])}
    step = milstein(lambda p, s, i: {"price": 0.1 * s["price"]}, lambda p, s, i: {"price": 0.3 * s["price"]}, 0.01)
    law = numpyro.handlers.trace(numpyro.handlers.seed(step, KEY)).get_trace(None, sites, None)["price"]["fn"]
    np.testing.assert_allclose(law.mean, 1.001 * sites["price"], rtol=1e-6)
    # (g g' / 2) dt = 0.045 x dt
    np.testing.assert_allclose(law.bend, 0.045 * 0.01 * sites["price"], rtol=1e-5)
    # the exact variance x^2 exp(2 mu dt) (exp(sigma^2 dt) - 1), up to dt^2 relative to it
    np.testing.assert_allclose(law.variance, sites["price"] ** 2 * np.exp(0.002) * np.expm1(0.0009), rtol=0.003)
    crossed = milstein(lambda p, s, i: {"price": s["price"]}, lambda p, s, i: {"price": s["price"][::-1]}, 0.01)
    law = numpyro.handlers.trace(numpyro.handlers.seed(crossed, KEY)).get_trace(None, sites, None)["price"]["fn"]
    assert np.isnan(law.bend).all()
