"""Bijectors, densities, masks, draws, parameters, and how a compiled model behaves inside other programs."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
import scipy.stats
from numpyro import handlers
from programs import initial, model, observation, transition


def constrained(*arguments):
    numpyro.sample("rate", dist.Gamma(2.0, 1.0))
    numpyro.sample("share", dist.Dirichlet(jnp.array([1.0, 2.0, 3.0])))
    numpyro.sample("box", dist.Uniform(jnp.array([-1.0, 2.0]), jnp.array([1.0, 5.0])))
    numpyro.sample("angle", dist.VonMises(0.3, 4.0))
    numpyro.sample("count", dist.Binomial(10, 0.4))
    numpyro.sample("matrix", dist.Normal(jnp.zeros((2, 2)), 1.0))


def chart_model():
    return model(constrained, constrained, lambda p, s, i: numpyro.sample("y", dist.Normal(s["rate"], 1.0))).compile()


@pytest.mark.full
def test_names_and_layout():
    names = ("rate", "share[0]", "share[1]", "box[0]", "box[1]", "angle", "count")
    names += ("matrix[0,0]", "matrix[0,1]", "matrix[1,0]", "matrix[1,1]")
    assert chart_model().coordinate_names == names
    assert chart_model().dimension == len(names)


@pytest.mark.full
def test_round_trip():
    compiled = chart_model()
    x = jax.jit(compiled.sample_initial)(jax.random.key(0), None)
    assert x.dtype == jnp.float32
    sites = compiled.to_sites(x)
    assert sites["count"].dtype == jnp.int32
    assert sites["matrix"].shape == (2, 2)
    np.testing.assert_allclose(sites["share"].sum(), 1, rtol=1e-6)
    np.testing.assert_allclose(compiled.to_flat(sites), x, rtol=1e-4, atol=1e-5)


@pytest.mark.full
def test_angles_are_unwrapped():
    """The bijector of an angle is the identity, its density periodic: no wall at pi."""
    compiled = chart_model()
    x = jax.jit(compiled.sample_initial)(jax.random.key(0), None)
    turned = x.at[5].add(2 * jnp.pi)
    assert compiled.to_sites(turned)["angle"] > jnp.pi
    density = jax.jit(jax.value_and_grad(compiled.log_initial))
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-5), density(turned), density(x))
    assert density(turned)[1][5] != 0


@pytest.mark.full
def test_discrete_sites_are_rounded():
    compiled = chart_model()
    x = jax.jit(compiled.sample_initial)(jax.random.key(0), None).at[6].set(3.4)
    assert compiled.to_sites(x)["count"] == 3


def test_log_det_is_that_of_the_jacobian():
    """Against automatic differentiation, site by site; the simplex by its first two entries."""
    with jax.enable_x64(True):
        compiled = chart_model()
        x = jnp.asarray(np.random.default_rng(0).normal(size=11))

        def volume_coordinates(x):
            sites = compiled.to_sites(x)
            return jnp.concatenate([sites["rate"][None], sites["share"][:2], sites["box"]])

        jacobian = jax.jacrev(volume_coordinates)(x)[:, :5]
        np.testing.assert_allclose(compiled.log_det(x), np.linalg.slogdet(jacobian)[1], rtol=1e-8)


def test_densities_integrate_to_one_in_the_flat_chart():
    def rate(*arguments):
        numpyro.sample("rate", dist.Gamma(2.0, 1.0))

    compiled = model(rate, rate, lambda p, s, i: numpyro.sample("y", dist.Normal(s["rate"], 1.0))).compile()
    grid = jnp.linspace(-15, 6, 4001)[:, None]
    for density in (compiled.log_initial, lambda x: compiled.log_transition(x, jnp.zeros(1))):
        total = jnp.exp(jax.jit(jax.vmap(density))(grid)).sum() * (grid[1, 0] - grid[0, 0])
        np.testing.assert_allclose(total, 1, rtol=1e-4)


def test_joint_density_term_by_term():
    compiled = model().compile()
    rng = np.random.default_rng(0)
    xs, ys = rng.normal(size=(4, 3)), rng.normal(size=4)
    norm = scipy.stats.norm.logpdf
    expected = norm(xs[0]).sum() + norm(xs[1:], xs[:-1], 0.5).sum() + norm(ys, xs[:, 0]).sum()
    found = jax.jit(compiled.log_joint)(xs, compiled.observe({"height": ys}), None)
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    alone = jax.jit(compiled.log_joint)(xs[:1], compiled.observe({"height": ys[:1]}), None)
    np.testing.assert_allclose(alone, norm(xs[0]).sum() + norm(ys[0], xs[0, 0]), rtol=1e-5)


def test_masked_entries_count_exactly_nothing():
    """Neither in the density nor in its gradient, whatever stands there and whatever the density would be there."""

    def program(params, state, inputs):
        numpyro.sample("y", dist.Normal(jnp.stack([state["level"], jnp.exp(50 * state["level"])]), 1.0))
        numpyro.sample("rate", dist.Gamma(jnp.exp(state["level"]), 1.0))

    compiled = model(observation=program).compile()
    x = jnp.ones(3)
    value_and_gradient = jax.jit(jax.value_and_grad(compiled.log_observation))
    some = compiled.observe({"y": [0.5, np.nan], "rate": np.nan})
    value, gradient = value_and_gradient(x, some)
    np.testing.assert_allclose(value, scipy.stats.norm.logpdf(0.5, 1, 1), rtol=1e-6)
    np.testing.assert_allclose(gradient, [-0.5, 0, 0], rtol=1e-6)
    nothing = compiled.observe({"y": [np.nan, np.nan], "rate": np.nan})
    value, gradient = value_and_gradient(x, nothing)
    assert value == 0
    assert (gradient == 0).all()


@pytest.mark.full
def test_mask_over_events():
    def program(params, state, inputs):
        numpyro.sample("y", dist.MultivariateNormal(state["slope"] * jnp.ones((3, 1)), jnp.eye(2)))

    compiled = model(observation=program).compile()
    values = np.zeros((3, 2))
    values[1] = np.nan
    found = compiled.log_observation(jnp.zeros(3), compiled.observe({"y": values}))
    np.testing.assert_allclose(
        found, 2 * scipy.stats.multivariate_normal.logpdf(np.zeros(2), np.zeros(2), np.eye(2)), rtol=1e-6
    )


@pytest.mark.full
def test_factors_scales_masks_and_plates_count():
    def program(params, state, inputs):
        numpyro.factor("heuristic", -3.0 * state["level"])
        with handlers.scale(scale=2.0):
            numpyro.sample("a", dist.Normal(0.0, 1.0))
        with handlers.mask(mask=False):
            numpyro.sample("b", dist.Normal(0.0, 1.0))
        with numpyro.plate("rows", 3):
            numpyro.sample("c", dist.Normal(state["level"], 1.0))

    compiled = model(observation=program).compile()
    x = jnp.array([0.7, 0.0, 0.0])
    found = compiled.log_observation(x, compiled.observe({"a": 0.1, "b": 0.2, "c": [0.0, 1.0, np.nan]}))
    norm = scipy.stats.norm.logpdf
    np.testing.assert_allclose(found, -2.1 + 2 * norm(0.1) + norm(0, 0.7) + norm(1, 0.7), rtol=1e-6)
    assert set(compiled.sample_observation(jax.random.key(0), x)) == {"a", "b", "c"}


def test_factor_alone_is_a_likelihood():
    compiled = model(observation=lambda p, s, i: numpyro.factor("f", -(s["level"] ** 2))).compile()
    nothing = compiled.observe({})
    assert compiled.log_observation(jnp.array([2.0, 0.0, 0.0]), nothing) == -4
    assert compiled.sample_observation(jax.random.key(0), jnp.zeros(3)) == {}


def test_extras_are_the_deterministic_sites():
    def program(params, state, inputs):
        numpyro.deterministic("double", 2 * state["level"])
        observation(params, state, inputs)

    found = model(observation=program).compile().extras(jnp.array([1.5, 0.0, 0.0]))
    assert set(found) == {"double"}
    assert found["double"] == 3


def test_draws_follow_the_densities():
    """Mean and spread of draws, 5 standard errors."""
    compiled = model().compile()
    keys = jax.random.split(jax.random.key(0), 4000)
    previous = jnp.array([3.0, -1.0, 2.0])
    draws = jax.jit(jax.vmap(lambda key: compiled.sample_transition(key, previous)))(keys)
    assert np.abs((draws.mean(0) - previous) / (0.5 / np.sqrt(4000))).max() < 5
    assert np.abs(draws.std(0) / 0.5 - 1).max() < 5 / np.sqrt(8000)
    correlation = np.corrcoef(draws.T) - np.eye(3)
    assert np.abs(correlation).max() < 5 / np.sqrt(4000)


def test_draws_of_a_site_follow_the_site_before_it():
    def chained(*arguments):
        level = numpyro.sample("level", dist.Normal(0.0, 1.0))
        numpyro.sample("slope", dist.Normal(level, 1e-4).expand([2]))

    compiled = model(chained, chained).compile()
    x = compiled.sample_initial(jax.random.key(0))
    np.testing.assert_allclose(x[1:], x[0], atol=1e-3)


@pytest.mark.parametrize("x64", [False, True])
def test_dtype_follows_the_default_float(x64):
    with jax.enable_x64(x64):
        compiled = chart_model()
        x = jax.eval_shape(compiled.sample_initial, jax.random.key(0), None)
        expected = jnp.float64 if x64 else jnp.float32
        assert x.dtype == expected
        assert jax.eval_shape(compiled.log_initial, x).dtype == expected
        assert jax.eval_shape(compiled.log_transition, x, x).dtype == expected
        data = compiled.observe({"y": 1.0})
        assert data.values["y"].dtype == expected
        assert jax.eval_shape(compiled.log_observation, x, data).dtype == expected


def prior():
    numpyro.sample("noise", dist.HalfNormal(1.0))


def parametric(params, state, inputs):
    numpyro.sample("height", dist.Normal(state["level"], params["noise"]))


def test_params_and_their_program():
    compiled = model(observation=parametric, parameters=prior).compile()
    data = compiled.observe({"height": 0.5})
    with pytest.raises(ValueError, match="use with_params"):
        compiled.log_observation(jnp.zeros(3), data)
    params = compiled.sample_parameters(jax.random.key(0))
    assert params["noise"] > 0
    expected = scipy.stats.halfnorm.logpdf(float(params["noise"]))
    np.testing.assert_allclose(compiled.log_parameters(params), expected, rtol=1e-5)
    with pytest.raises(ValueError, match="no parameters program"):
        model().compile().sample_parameters(jax.random.key(0))

    @jax.jit
    def density(noise):
        return compiled.with_params({"noise": noise}).log_observation(jnp.zeros(3), data)

    np.testing.assert_allclose(density(2.0), scipy.stats.norm.logpdf(0.5, 0, 2), rtol=1e-6)
    assert np.isfinite(jax.grad(density)(2.0))


@pytest.mark.full
def test_nothing_leaks_into_a_program_around_it():
    compiled = model(observation=observation).compile()
    data = compiled.observe({"height": 0.5})
    alone = compiled.log_observation(jnp.zeros(3), data)
    drawn = compiled.sample_initial(jax.random.key(5))

    def outer():
        numpyro.sample("before", dist.Normal(0.0, 1.0))
        with handlers.scale(scale=10.0), handlers.mask(mask=False), numpyro.plate("around", 3):
            inner = compiled.log_observation(jnp.zeros(3), data)
            x = compiled.sample_initial(jax.random.key(5))
            numpyro.factor("likelihood", inner)
        numpyro.sample("after", dist.Normal(0.0, 1.0))
        return inner, x

    def without():
        numpyro.sample("before", dist.Normal(0.0, 1.0))
        numpyro.sample("after", dist.Normal(0.0, 1.0))

    with handlers.trace() as sites, handlers.seed(rng_seed=0), handlers.condition(data={"level": 9.0, "height": 9.0}):
        inner, x = outer()
    with handlers.trace() as plain, handlers.seed(rng_seed=0):
        without()
    assert list(sites) == ["before", "around", "likelihood", "after"]
    assert inner == alone
    np.testing.assert_array_equal(x, drawn)
    assert sites["after"]["value"] == plain["after"]["value"]


@pytest.mark.full
def test_runs_in_jit_vmap_grad_and_scan_without_a_retrace():
    traces = []

    def counted(params, state, inputs):
        traces.append(1)
        observation(params, state, inputs)

    compiled = model(initial, transition, counted).compile()
    data = compiled.observe({"height": np.arange(5.0)})

    @jax.jit
    def total(xs, data):
        def step(carry, item):
            return carry + jax.vmap(compiled.log_observation, (0, None))(xs, item).sum(), None

        return jax.lax.scan(step, 0.0, data)[0]

    traces.clear()
    gradient = jax.jit(jax.grad(total))
    gradient(jnp.zeros((7, 3)), data)
    count = len(traces)
    gradient(jnp.ones((7, 3)), data._replace(mask={"height": jnp.array([True, False] * 2 + [True])}))
    assert len(traces) == count <= 2
