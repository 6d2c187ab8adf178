"""The log-likelihood of params and its gradient, against a textbook Kalman filter and its finite differences."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from oracles.kalman import kalman_filter as exact_filter
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices

import poseppl
from poseppl import ensemble_kalman_filter, guided_filter, kalman_filter, log_likelihood, particle_filter
from poseppl.errors import InputError
from poseppl.filters import adaptive_resampling, annealed_filter, rao_blackwellised_filter, tempered_filter
from poseppl.program import StateSpaceModel

PARAMS = {"memory": 0.7, "step": 0.5, "noise": 0.6}
YS = np.random.default_rng(0).normal(size=(8, 2)).astype(np.float32).astype(float)
MASK = np.ones((8, 2), bool)
MASK[3] = MASK[5, 0] = False


def program():
    def parameters():
        numpyro.sample("memory", dist.Uniform(-1.0, 1.0))
        numpyro.sample("step", dist.HalfNormal(1.0))
        numpyro.sample("noise", dist.HalfNormal(1.0))

    def initial(params, inputs):
        numpyro.sample("x", dist.Normal(jnp.zeros(2), 1.0))

    def transition(params, state, inputs):
        numpyro.sample("x", dist.Normal(params["memory"] * state["x"], params["step"]))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["x"], params["noise"]))

    return StateSpaceModel(initial, transition, observation, parameters)


MODEL = program().compile()
DATA = {"y": np.where(MASK, YS, np.nan)}


def exact(params):
    A, Q, R = params["memory"] * np.eye(2), params["step"] ** 2 * np.eye(2), params["noise"] ** 2 * np.eye(2)
    matrices = linear_gaussian_matrices(2, A=A, Q=Q, R=R, P=np.eye(2), m=np.zeros(2))
    return float(exact_filter(matrices, YS, MASK).log_evidence.sum())


def slope(function, params, width=1e-5):
    """Central differences by name."""
    return {
        name: (function(params | {name: value + width}) - function(params | {name: value - width})) / (2 * width)
        for name, value in params.items()
    }


def value_and_gradient(build, **of):
    return jax.jit(jax.value_and_grad(lambda params, key: log_likelihood(MODEL, params, DATA, build, key, **of)))


@pytest.mark.full
@pytest.mark.parametrize("linearisation", ["first-order", "unscented"])
def test_kalmans_value_and_gradient_are_exact(linearisation):
    with jax.enable_x64(True):
        found = value_and_gradient(lambda model: kalman_filter(model, 1, linearisation=linearisation))
        value, gradient = found(PARAMS, jax.random.key(0))
    np.testing.assert_allclose(value, exact(PARAMS), rtol=1e-9)
    wanted = slope(exact, PARAMS)
    np.testing.assert_allclose([gradient[name] for name in wanted], list(wanted.values()), rtol=1e-6)


@pytest.mark.full
def test_many_params_at_once():
    many = {name: value * jnp.linspace(0.8, 1.2, 5) for name, value in PARAMS.items()}
    build = lambda model: kalman_filter(model, 1)  # noqa: E731
    found = jax.jit(jax.vmap(lambda params: log_likelihood(MODEL, params, DATA, build)))(many)
    wanted = [exact({name: float(values[i]) for name, values in many.items()}) for i in range(5)]
    np.testing.assert_allclose(found, wanted, rtol=1e-4)


@pytest.mark.full
@pytest.mark.parametrize("form", ["square-root", "stochastic"])
def test_the_ensembles_gradient_is_that_of_its_value(form):
    """For given draws; with many members it is Kalman's, within Monte Carlo error."""
    with jax.enable_x64(True):
        found = value_and_gradient(lambda model: ensemble_kalman_filter(model, 20, form=form))
        key = jax.random.key(2)
        gradient = found(PARAMS, key)[1]
        wanted = slope(lambda params: float(found(params, key)[0]), PARAMS)
    np.testing.assert_allclose([gradient[name] for name in wanted], list(wanted.values()), rtol=1e-5)


@pytest.mark.slow
def test_the_ensembles_gradient_comes_to_kalmans():
    many = jax.jit(jax.vmap(value_and_gradient(lambda model: ensemble_kalman_filter(model, 1000)), (None, 0)))
    gradients = many(PARAMS, jax.random.split(jax.random.key(0), 40))[1]
    for name, wanted in slope(exact, PARAMS).items():
        error = gradients[name].std(ddof=1) / np.sqrt(40)
        assert abs(gradients[name].mean() - wanted) < 5 * error + 0.02 * abs(wanted), name


BUILDS = {
    "particle": lambda model: particle_filter(model, 100),
    "multinomial": lambda model: particle_filter(model, 100, resampling="multinomial", ess_threshold=0.7),
    "auxiliary": lambda model: guided_filter(model, 50, auxiliary=True),
}


def likelihood_gradient(build, replicates=2000):
    """Mean of the gradient of the likelihood over the exact one, by name, with its standard error; and the values'."""
    many = jax.jit(jax.vmap(value_and_gradient(build), (None, 0)))
    values, gradients = many(PARAMS, jax.random.split(jax.random.key(1), replicates))
    ratio = np.exp(np.asarray(values, float) - exact(PARAMS))
    weighed = {name: ratio * np.asarray(gradient, float) for name, gradient in gradients.items()}
    return {name: (each.mean(), each.std(ddof=1) / np.sqrt(replicates)) for name, each in weighed.items()}


def distances(found):
    """From the exact gradient of the log-likelihood, in standard errors."""
    wanted = slope(exact, PARAMS)
    return [abs(mean - wanted[name]) / error for name, (mean, error) in found.items()]


@pytest.mark.slow
@pytest.mark.parametrize("name", BUILDS)
def test_the_particle_filters_gradient_of_the_likelihood_is_unbiased(name):
    assert max(distances(likelihood_gradient(BUILDS[name]))) < 5


@pytest.mark.full
def test_a_gradient_that_leaves_out_the_ancestors_is_noticed(monkeypatch):
    monkeypatch.setattr(adaptive_resampling, "_children", lambda log_start, log_drawn, ancestors: log_start[ancestors])
    assert max(distances(likelihood_gradient(BUILDS["particle"]))) > 10


@pytest.mark.full
@pytest.mark.parametrize("build", [lambda model: kalman_filter(model, 2), lambda model: ensemble_kalman_filter(model, 5)])
@pytest.mark.parametrize("missing", [slice(0, 1), slice(0, 8)], ids=["first", "all"])
def test_masked_frames_add_nothing_and_no_nan(build, missing):
    data = {"y": np.array(DATA["y"])}
    data["y"][missing] = np.nan
    value, gradient = jax.jit(jax.value_and_grad(lambda params: log_likelihood(MODEL, params, data, build)))(PARAMS)
    assert all(np.isfinite(each) for each in (value, *gradient.values()))
    assert (missing == slice(0, 8)) == all(each == 0 for each in (value, *gradient.values()))


@pytest.mark.full
def test_a_posterior_without_a_factor_has_a_gradient():
    """A coordinate that is known exactly leaves a singular covariance, whose factor, of the draws, has no derivative."""

    def start(params, *rest):
        numpyro.sample("x", dist.Normal(jnp.array([0.0, 1.0]), jnp.array([1.0, 1e-200])))

    def seen(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["x"][0], params["noise"]))

    model = StateSpaceModel(start, start, seen, lambda: numpyro.sample("noise", dist.HalfNormal(1.0))).compile()
    data, params = {"y": [0.3, -0.8]}, {"noise": 0.5}
    with jax.enable_x64(True):
        found = jax.grad(lambda params: log_likelihood(model, params, data, lambda model: kalman_filter(model, 2)))(params)
    variance = 1.25
    wanted = sum(0.5 * (y**2 / variance**2 - 1 / variance) * 2 * 0.5 for y in data["y"])
    np.testing.assert_allclose(found["noise"], wanted, rtol=1e-6)


@pytest.mark.full
def test_inputs_that_do_not_change():
    def pushed(params, state, inputs):
        numpyro.sample("x", dist.Normal(state["x"] + inputs["push"], inputs["step"]))

    def start(params, inputs):
        numpyro.sample("x", dist.Normal(0.0, 1.0))

    model = StateSpaceModel(start, pushed, lambda params, state, inputs: numpyro.sample("y", dist.Normal(state["x"], 1.0)))
    compiled = model.compile({"push": 0.0, "step": 1.0})

    def value(step):
        inputs = {"push": jnp.array([0.0, 1.0, 2.0]), "step": poseppl.Constant(step)}
        return log_likelihood(compiled, None, {"y": [0.1, 0.9, 3.2]}, lambda model: kalman_filter(model, 1), inputs=inputs)

    with jax.enable_x64(True):
        found = jax.grad(value)(0.5)
        np.testing.assert_allclose(found, (value(0.5 + 1e-6) - value(0.5 - 1e-6)) / 2e-6, rtol=1e-5)


def test_a_filter_of_other_params_is_refused():
    """It would give every params the same value."""
    one = kalman_filter(MODEL.with_params(PARAMS | {"noise": 0.2}))
    for filter, match in ((one, "The filter is a Filter. Expected a function"), (lambda _: one, "another model, whose params")):
        with pytest.raises(ValueError, match=match):
            log_likelihood(MODEL, PARAMS, DATA, filter)


@pytest.mark.full
def test_gradients_that_know_nothing_of_moves_are_refused_and_so_is_what_has_no_evidence():
    def of_params(params, build):
        return log_likelihood(MODEL, params, DATA, build)

    tempered = lambda model: tempered_filter(model, 20)  # noqa: E731
    assert np.isfinite(jax.jit(lambda params: of_params(params, tempered))(PARAMS))
    with pytest.raises(InputError, match="filter: its moves are accepted or refused, and no gradient"):
        jax.grad(of_params)(PARAMS, tempered)
    with pytest.raises(ValueError, match="seeks a mode, and has no evidence"):
        of_params(PARAMS, lambda model: annealed_filter(model, num_particles=20))


def test_other_params_and_data_are_refused():
    with pytest.raises(InputError, match="params are .*memory.*expected those of the parameters program"):
        log_likelihood(MODEL, {"memory": 0.5}, DATA, kalman_filter)
    programs = MODEL.programs._replace(parameters=None)
    bound = programs.compile(params=PARAMS)
    with pytest.raises(InputError, match="params are .*memory.*expected those that the model has"):
        log_likelihood(bound, {"memory": 0.5}, DATA, kalman_filter)
    with pytest.raises(InputError, match="y: the data are not those of a sequence"):
        log_likelihood(MODEL, PARAMS, MODEL.observe({"y": YS[0]}), kalman_filter)


SWITCHING = {"stay": 0.8, "jump": 1.5, "noise": 0.5}
JUMPY = np.array([0.2, 1.4, 2.6])


def switching_model():
    """A walk that steps by `jump` while it is busy; busy does not change with probability `stay`."""

    def parameters():
        numpyro.sample("stay", dist.Uniform(0.0, 1.0))
        numpyro.sample("jump", dist.Normal(0.0, 1.0))
        numpyro.sample("noise", dist.HalfNormal(1.0))

    def initial(params, inputs):
        numpyro.sample("busy", dist.Bernoulli(params["stay"]))
        numpyro.sample("x", dist.Normal(0.0, 1.0))

    def transition(params, state, inputs):
        busy = numpyro.sample("busy", dist.Bernoulli(jnp.where(state["busy"] == 1, params["stay"], 1 - params["stay"])))
        numpyro.sample("x", dist.Normal(state["x"] + params["jump"] * busy, 0.5))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["x"], params["noise"]))

    return StateSpaceModel(initial, transition, observation, parameters).compile()


def switching_evidence(params):
    """The likelihood, summed over all paths of busy, each of which leaves a Gaussian."""
    frames = np.arange(len(JUMPY))
    covariance = 1 + 0.25 * np.minimum(frames[:, None], frames) + params["noise"] ** 2 * np.eye(len(JUMPY))
    total = 0.0
    for path in np.ndindex(2, 2, 2):
        stays = [path[0] == 1, *(np.diff(path) == 0)]
        probability = np.prod(np.where(stays, params["stay"], 1 - params["stay"]))
        residual = JUMPY - params["jump"] * np.cumsum([0, *path[1:]])
        exponent = -0.5 * residual @ np.linalg.solve(covariance, residual)
        total += probability * np.exp(exponent) / np.sqrt(np.linalg.det(2 * np.pi * covariance))
    return total


@pytest.mark.parametrize(
    "build",
    [particle_filter, *(pytest.param(build, marks=pytest.mark.full) for build in (guided_filter, rao_blackwellised_filter))],
)
def test_finite_sites_have_their_score(build):
    """Their draws know nothing of the probabilities that they were drawn by: without the score the derivative by these is 0."""
    model, replicates = switching_model(), 1000

    def of_params(params, key):
        return log_likelihood(model, params, {"y": JUMPY}, lambda bound: build(bound, 50), key)

    many = jax.jit(jax.vmap(jax.value_and_grad(of_params), (None, 0)))
    values, gradients = many(SWITCHING, jax.random.split(jax.random.key(3), replicates))
    exact_value = switching_evidence(SWITCHING)
    ratio = np.exp(np.asarray(values, float)) / exact_value
    assert abs(ratio.mean() - 1) < 5 * ratio.std(ddof=1) / np.sqrt(replicates)
    for name, wanted in slope(switching_evidence, SWITCHING).items():
        each = ratio * np.asarray(gradients[name], float)
        error = each.std(ddof=1) / np.sqrt(replicates)
        assert abs(each.mean() - wanted / exact_value) < 5 * error, name
        assert abs(wanted / exact_value) > 10 * error, name
