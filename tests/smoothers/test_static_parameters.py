"""Learning static parameters: particle Gibbs and PMMH against a grid with Kalman's evidence; wrong ones are noticed."""

from __future__ import annotations

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from law_problems import z_scores
from oracles.kalman import kalman_filter
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices

from poseppl.diagnostics.inefficiency import array_stats
from poseppl.errors import InputError
from poseppl.filters import kalman_filter as kalman, particle_filter
from poseppl.kernels.adaptive_covariance import initial_covariance
from poseppl.program import StateSpaceModel
from poseppl.program.parameters import ParameterBijector, parameter_bijector
from poseppl.runs.run import Constant
from poseppl.smoothers import particle_marginal
from poseppl.smoothers.particle_marginal import pmmh
from poseppl.smoothers.static_parameters import particle_gibbs

YS = np.array([0.3, -1.1, 0.9, 2.0, 0.2, -0.6, 0.5, 1.8, 1.1, -0.4])
CHAINS = 24


def parameters():
    numpyro.sample("noise", dist.LogNormal(-0.5, 0.7))


def initial(params, inputs):
    numpyro.sample("x", dist.Normal(0.0, 1.0))


def transition(params, state, inputs):
    numpyro.sample("x", dist.Normal(0.8 * state["x"], 0.6))


def observation(params, state, inputs):
    numpyro.sample("y", dist.Normal(state["x"], params["noise"]))


@cache
def posed():
    model = StateSpaceModel(initial, transition, observation, parameters).compile()
    return model, model.observe({"y": YS})


@cache
def exact():
    """Mean and second moment about it of the log-noise, and the mean of each state, on a grid of log-noises."""
    grid = np.linspace(-5.0, 3.0, 401)
    log_posterior = []
    for u in grid:
        matrices = linear_gaussian_matrices(1, A=[[0.8]], Q=[[0.36]], R=[[np.exp(2 * u)]])
        log_posterior.append(kalman_filter(matrices, YS[:, None]).log_evidence.sum() - 0.5 * ((u + 0.5) / 0.7) ** 2)
    weights = np.exp(np.array(log_posterior) - max(log_posterior))
    weights /= weights.sum()
    mean = weights @ grid
    return np.array([mean, weights @ (grid - mean) ** 2])


def scores(unconstrained):
    """z-scores of the mean and the second moment; each chain is a replicate."""
    u = np.asarray(unconstrained)[..., 0]
    chains = np.stack([u.mean(1), ((u - exact()[0]) ** 2).mean(1)], 1)
    return z_scores(chains, exact())


def run_gibbs(**settings):
    model, observations = posed()
    settings = {"num_particles": 8, "num_chains": CHAINS, "num_draws": 300, "num_warmup": 100, **settings}
    return jax.jit(lambda key: particle_gibbs(model, key, observations, **settings))(jax.random.key(0))


def run_pmmh(num_particles=10, num_draws=1200, **settings):
    model, observations = posed()

    def run(key):
        return pmmh(
            model,
            key,
            observations,
            build_filter=lambda bound: particle_filter(bound, num_particles),
            num_chains=CHAINS,
            num_draws=num_draws,
            num_warmup=200,
            **settings,
        )

    return jax.jit(run)(jax.random.key(1))


@pytest.mark.full
@pytest.mark.parametrize("method", ["ancestor", "backward"])
def test_particle_gibbs_has_the_posterior_of_the_grid(method):
    result = run_gibbs(method=method)
    assert np.abs(scores(result.unconstrained)).max() < 5
    np.testing.assert_allclose(result.params["noise"], np.exp(result.unconstrained[..., 0]), rtol=1e-5)
    assert result.smoothed.particles.shape == (10, CHAINS, 300, 1)
    assert 0.6 < float(result.acceptance) < 0.99
    assert float(result.smoothed.info.divergences) <= 0.01 * CHAINS * 300
    assert (np.asarray(result.smoothed.info.acceptance) > 0.3).all()


@pytest.mark.full
def test_pmmh_has_the_posterior_of_the_grid():
    result = run_pmmh()
    assert np.abs(scores(result.unconstrained)).max() < 5
    assert 0.1 < float(result.acceptance) < 0.4
    assert np.isfinite(result.log_evidence).all()


@pytest.mark.slow
def test_a_chart_without_its_determinant_is_noticed(monkeypatch):
    monkeypatch.setattr(ParameterBijector, "log_det", lambda bijector, u: jnp.zeros(()))
    assert np.abs(scores(run_gibbs().unconstrained)).max() > 7
    assert np.abs(scores(run_pmmh().unconstrained)).max() > 7


@pytest.mark.full
def test_evidence_that_is_estimated_again_is_noticed(monkeypatch):
    right = particle_marginal._update

    def wrong(evaluate, num_warmup, state, row):
        key, key_again = jax.random.split(row[0])
        log_posterior, _ = jax.vmap(evaluate)(jax.random.split(key_again, CHAINS), state.positions)
        return right(evaluate, num_warmup, state._replace(log_posterior=log_posterior), (key, row[1]))

    monkeypatch.setattr(particle_marginal, "_update", wrong)
    assert np.abs(scores(run_pmmh().unconstrained)).max() > 7


@pytest.mark.slow
def test_no_key_is_used_twice():
    model, observations = posed()
    settings = {"num_chains": 2, "num_draws": 2, "num_warmup": 1}

    def run(key_gibbs, key_pmmh):
        filtered = {"build_filter": lambda bound: particle_filter(bound, 5), **settings}
        return (
            particle_gibbs(model, key_gibbs, observations, num_particles=3, **settings).unconstrained,
            pmmh(model, key_pmmh, observations, start={"noise": 0.5}, **filtered).unconstrained,
        )

    with jax.debug_key_reuse(True):
        for draws in jax.jit(run)(jax.random.key(0), jax.random.key(1)):
            assert np.isfinite(draws).all()


@pytest.mark.full
def test_the_chart_of_params():
    def program():
        numpyro.sample("noise", dist.LogNormal(0.0, 1.0))
        numpyro.sample("share", dist.Beta(2.0, 3.0).expand([2]).to_event(1))
        numpyro.sample("shift", dist.Normal(0.0, 1.0))

    model = StateSpaceModel(initial, transition, observation, program).compile()
    bijector = parameter_bijector(model)
    assert bijector.coordinate_names == ("noise", "share[0]", "share[1]", "shift")
    params = {"noise": 0.3, "share": jnp.array([0.2, 0.9]), "shift": -1.0}
    u = bijector.to_flat(params)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-5), bijector.to_params(u), params)
    share = np.array([0.2, 0.9])
    assert float(bijector.log_det(u)) == pytest.approx(np.log(0.3) + np.log(share * (1 - share)).sum(), rel=1e-5)
    assert float(bijector.log_prior(model, u)) == pytest.approx(
        float(model.log_parameters(params) + bijector.log_det(u)), rel=1e-5
    )


@pytest.mark.full
def test_what_cannot_be_learned_is_reported():
    def counts():
        numpyro.sample("noise", dist.Poisson(3.0))

    def nested():
        top = numpyro.sample("top", dist.LogNormal(0.0, 1.0))
        numpyro.sample("noise", dist.Uniform(0.0, top))

    model, observations = posed()
    with pytest.raises(ValueError, match="integer"):
        parameter_bijector(StateSpaceModel(initial, transition, observation, counts).compile())
    with pytest.raises(ValueError, match="depends on another"):
        parameter_bijector(StateSpaceModel(initial, transition, observation, nested).compile())
    with pytest.raises(ValueError, match="no parameters program"):
        parameter_bijector(StateSpaceModel(initial, transition, observation).compile(params={"noise": 0.1}))
    with pytest.raises(ValueError, match="num_particles"):
        particle_gibbs(model, jax.random.key(0), observations, num_particles=1)
    with pytest.raises(ValueError, match="num_draws"):
        pmmh(model, jax.random.key(0), observations, build_filter=lambda bound: particle_filter(bound, 10), num_draws=0)
    for sample in (pmmh, particle_gibbs):
        options = {"build_filter": particle_filter} if sample is pmmh else {}
        with pytest.raises(ValueError, match="The data are a dict. Expected an Observation"):
            sample(model, jax.random.key(0), {"y": YS}, **options)


@pytest.mark.full
@pytest.mark.parametrize("sample", ["pmmh", "particle gibbs"])
def test_constant_inputs_are_repeated_and_others_have_the_frames_of_the_data(sample):
    def moved(params, state, inputs):
        numpyro.sample("x", dist.Normal(0.8 * state["x"] + inputs["push"] @ inputs["gain"], 0.6))

    shapes = {"push": jnp.zeros(2), "gain": jnp.zeros(2)}
    model = StateSpaceModel(initial, moved, observation, parameters).compile(shapes)
    observations, key = model.observe({"y": YS}), jax.random.key(0)
    push, gain = np.random.default_rng(0).normal(size=(10, 2)).astype(np.float32), np.array([0.3, -0.5], np.float32)
    settings = {"num_chains": 2, "num_draws": 2, "num_warmup": 1}

    def run(inputs, data=observations):
        if sample == "pmmh":
            return pmmh(model, key, data, inputs, build_filter=lambda bound: kalman(bound, 2), **settings).log_evidence
        return particle_gibbs(model, key, data, inputs, num_particles=4, **settings).smoothed.particles

    repeated = run({"push": push, "gain": np.tile(gain, (10, 1))})
    np.testing.assert_array_equal(run({"push": push, "gain": Constant(gain)}), repeated)
    for inputs, data, match in (
        (
            {"push": push[:9], "gain": Constant(gain)},
            observations,
            r"push'\] has shape \(9, 2\); expected .* 10 frames",
        ),
        ({"push": push, "gain": gain}, observations, r"inputs\['gain'\] has shape \(2,\); expected .* wrap .* in Constant"),
        (None, model.observe({"y": YS[0]}), r"the data are not those of a sequence .expected shape .T,., T at least 1"),
        (None, model.observe({"y": YS[:0]}), r"the data are not those of a sequence"),
    ):
        with pytest.raises((ValueError, InputError), match=match):
            run(inputs, data)


@pytest.mark.full
def test_a_start_that_is_no_value_of_the_params_is_refused():
    """Chains of NaN would neither move nor be noticed."""
    model, observations = posed()
    for start, match in (
        ({"noise": -0.5}, "start: noise is -0.5 .expected a value inside of its support"),
        ({"noise": float("nan")}, "start: noise is nan"),
        ({"level": 1.0}, r"start: the names \['level'\] .expected those of the parameters program, \['noise'\]"),
        ({"noise": [1.0, 2.0]}, r"start: noise has shape \(2,\) .expected \(\)"),
    ):
        with pytest.raises(InputError, match=match):
            pmmh(model, jax.random.key(0), observations, build_filter=particle_filter, start=start)
        with pytest.raises(InputError, match=match):
            particle_gibbs(model, jax.random.key(0), observations, start=start)


def test_a_filter_of_other_params_is_refused_by_pmmh():
    """It would give every params the same evidence, and the prior for a posterior."""
    model, observations = posed()
    one = particle_filter(model.with_params({"noise": 0.5}), 10)
    for build_filter, match in (
        (one, "The filter is a Filter. Expected a function"),
        (lambda _: one, "another model, whose params"),
    ):
        with pytest.raises(ValueError, match=match):
            pmmh(model, jax.random.key(0), observations, build_filter=build_filter)


@pytest.mark.full
def test_proposals_of_pmmh_do_not_shrink_because_the_likelihood_is_noisy():
    """A standard Gaussian in two coordinates, whose log-density has noise of SD 1.7 and is unbiased in its exponential."""

    def evaluate(key, u):
        value = -0.5 * jnp.sum(u**2) + 1.7 * jax.random.normal(key) - 1.7**2 / 2
        return value, value

    warmup, zero, near = 1000, jnp.zeros(1), initial_covariance(jax.random.normal(jax.random.key(0), (64, 2)))
    first = particle_marginal._State(jnp.zeros((1, 2)), zero, zero, jnp.zeros(()), near)
    rows = jax.random.split(jax.random.key(1), 5 * warmup), jnp.arange(5 * warmup)
    _, (draws, _, _) = jax.lax.scan(partial(particle_marginal._update, evaluate, warmup), first, rows)
    kept = np.asarray(draws[warmup:, 0])
    ess = array_stats().ess(kept.T[:, None])
    assert (ess > 40).all()
    assert (np.abs(kept.mean(0)) < 5 / np.sqrt(ess)).all()
    assert (np.abs(kept.var(0) - 1) < 5 * np.sqrt(2 / ess)).all()


@pytest.mark.parametrize(("number", "stays"), [(0, False), (9, False), (10, True), (500, True)])
def test_proposals_of_pmmh_stay_once_the_draws_count(number, stays):
    """Their scale and covariance are learned from the ten updates of the warm-up, and from no later one."""
    known = initial_covariance(jnp.arange(6.0).reshape(3, 2))
    state = particle_marginal._State(jnp.ones((3, 2)), jnp.zeros(3), jnp.zeros(3), jnp.zeros(()), known)
    after = particle_marginal._adapt(state, jnp.asarray(0.9), jnp.int32(number), 10)
    assert (float(after.log_scale) == 0.0) == stays
    assert np.array_equal(after.known.mean, known.mean) == stays
    assert np.array_equal(after.known.covariance, known.covariance) == stays
