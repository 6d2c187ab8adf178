"""Toys against what is known of them: densities from the formulae, draws from their moments, oracles against each other."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.stats
from oracles.forward_backward import forward_backward
from oracles.kalman import joint_log_density, kalman_filter, simulate
from oracles.quadrature import moments_on_grid
from poseppl_models.toys.banana import banana
from poseppl_models.toys.finite_hmm import finite_hmm
from poseppl_models.toys.growth import growth, growth_mean
from poseppl_models.toys.linear_gaussian import linear_gaussian, linear_gaussian_matrices, linear_gaussian_model
from poseppl_models.toys.lorenz96 import TIME_STEP, lorenz96, lorenz96_derivative, lorenz96_step

from poseppl.filters import particle_filter

FULL = [[1.0, 0.3], [0.3, 0.5]]


@pytest.mark.full
@pytest.mark.parametrize(
    "matrices", [{}, {"Q": FULL, "R": FULL, "P": FULL}, {"B": [[1.0], [2.0]]}], ids=["default", "full", "inputs"]
)
def test_linear_gaussian_joint_density(matrices):
    matrices = linear_gaussian_matrices(2, **matrices)
    inputs = None if matrices.B is None else np.linspace(-1, 1, 4)[:, None]
    model = linear_gaussian_model(matrices).compile(None if inputs is None else inputs[0])
    xs, ys = simulate(matrices, 4, seed=0, inputs=inputs)
    with jax.enable_x64(True):
        found = jax.jit(model.log_joint)(jnp.asarray(xs), model.observe({"y": ys}), inputs)
    np.testing.assert_allclose(found, joint_log_density(matrices, xs, ys, inputs), rtol=1e-6)


def test_linear_gaussian_in_many_dimensions():
    model = linear_gaussian(28, 10).compile()
    assert model.dimension == 28
    assert model.observation_sites["y"].shape == (10,)
    assert model.coordinate_names[27] == "x[27]"


def test_linear_gaussian_refuses_shapes_that_do_not_fit():
    with pytest.raises(ValueError, match=r"R has shape \(1, 1\)"):
        linear_gaussian_matrices(2, R=[[1.0]])
    with pytest.raises(ValueError, match="B has shape"):
        linear_gaussian_matrices(2, B=[1.0])


@pytest.mark.parametrize("dimension", [1, 3])
def test_growth_densities(dimension):
    model = growth(dimension).compile(1.0)
    rng = np.random.default_rng(0)
    xs = rng.normal(0, 5, (3, dimension))
    ys = rng.normal(5, 2, (3, dimension))
    times = np.arange(1.0, 4.0)
    expected = scipy.stats.norm.logpdf(xs[0], 0, np.sqrt(10)).sum() + scipy.stats.norm.logpdf(ys, xs**2 / 20, 1).sum()
    for t in (1, 2):
        mean = xs[t - 1] / 2 + 25 * xs[t - 1] / (1 + xs[t - 1] ** 2) + 8 * np.cos(1.2 * times[t])
        expected += scipy.stats.norm.logpdf(xs[t], mean, np.sqrt(10)).sum()
    observations = model.observe({"y": ys if dimension > 1 else ys[:, 0]})
    np.testing.assert_allclose(jax.jit(model.log_joint)(xs, observations, times), expected, rtol=1e-5)
    assert model.coordinate_names == (("x",) if dimension == 1 else ("x[0]", "x[1]", "x[2]"))


@pytest.mark.full
def test_growth_filter_against_a_grid():
    """Filtered means and evidence of a particle filter against a grid filter, within 5 standard errors of replicates."""
    rng = np.random.default_rng(4)
    num_frames, x = 12, rng.normal(0, np.sqrt(10))
    ys = []
    for t in range(1, num_frames + 1):
        x = x if t == 1 else growth_mean(x, t) + rng.normal(0, np.sqrt(10))
        ys.append(x**2 / 20 + rng.normal())
    ys, times = np.array(ys), np.arange(1.0, num_frames + 1)
    grid = np.linspace(-40, 40, 1601)
    cell = grid[1] - grid[0]
    means, log_evidence = [], 0.0
    for t in range(num_frames):
        if t == 0:
            density = scipy.stats.norm.pdf(grid, 0, np.sqrt(10))
        else:
            density = scipy.stats.norm.pdf(grid[:, None], growth_mean(grid, times[t])[None], np.sqrt(10)) @ density * cell
        density = density * scipy.stats.norm.pdf(ys[t], grid**2 / 20, 1)
        total = density.sum() * cell
        log_evidence += np.log(total)
        density /= total
        means.append((grid * density).sum() * cell)
    model = growth().compile(1.0)
    built = particle_filter(model, 3000)
    observations = model.observe({"y": ys})

    def one(rng_key):
        keys = jax.random.split(rng_key, num_frames)
        state, info = built.init(keys[0], jax.tree.map(lambda a: a[0], observations), times[0])
        first = jnp.exp(state.log_weights) @ state.particles[:, 0]

        def step(state, item):
            state, info = built.step(item[0], state, *item[1])
            return state, (jnp.exp(state.log_weights) @ state.particles[:, 0], info.log_evidence)

        rest = (keys[1:], (jax.tree.map(lambda a: a[1:], observations), jnp.asarray(times[1:])))
        _, (later, evidence) = jax.lax.scan(step, state, rest)
        return jnp.concatenate([first[None], later]), info.log_evidence + evidence.sum()

    keys = jax.random.split(jax.random.key(0), 40)
    found, evidence = (np.asarray(a, float) for a in jax.jit(lambda keys: jax.lax.map(one, keys))(keys))
    assert (np.abs(found.mean(0) - means) / (found.std(0, ddof=1) / np.sqrt(40))).max() < 5
    ratio = np.exp(evidence - log_evidence)
    assert abs(ratio.mean() - 1) < 5 * ratio.std(ddof=1) / np.sqrt(40)


@pytest.mark.full
@pytest.mark.parametrize("dimension", [4, 5, 40])
def test_lorenz96_derivative_against_a_loop_over_the_circle(dimension):
    x = np.random.default_rng(dimension).normal(2, 4, dimension)
    d = dimension
    expected = [(x[(i + 1) % d] - x[(i - 2) % d]) * x[(i - 1) % d] - x[i] + 8.0 for i in range(d)]
    np.testing.assert_allclose(lorenz96_derivative(x), expected, rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(lorenz96_derivative(x, 5.0), np.array(expected) - 3, rtol=1e-5, atol=1e-4)


def test_lorenz96_frame_is_a_step_of_the_flow():
    x = np.random.default_rng(0).normal(2, 1, 40)
    flow = scipy.integrate.solve_ivp(lambda _, x: np.asarray(lorenz96_derivative(x)), (0, 0.05), x, rtol=1e-10, atol=1e-10)
    with jax.enable_x64(True):
        found = np.asarray(lorenz96_step(x))
    assert TIME_STEP == 0.05
    error, moved = np.abs(found - flow.y[:, -1]).max(), np.abs(found - x).max()
    assert error < 1e-4 * moved  # the second order leaves more than 1e-3


@pytest.mark.full
def test_lorenz96_densities():
    model = lorenz96(6, 0.5, stride=2, transition_noise=0.2, forcing=5.0).compile()
    rng = np.random.default_rng(1)
    xs, ys = rng.normal(2, 3, (2, 6)), rng.normal(2, 3, (2, 3))
    found = [jax.jit(model.log_joint)(xs, model.observe({"y": y})) for y in (ys, ys + [[0, 0, 0.3], [0, 0, 0]])]
    normal = scipy.stats.norm.logpdf
    moved, kept = model.log_transition(xs[1], xs[0]), normal(xs[1], np.asarray(lorenz96_step(xs[0], 5.0)), 0.2).sum()
    np.testing.assert_allclose(moved, kept, rtol=1e-4)
    expected = normal(ys[0, 2] + 0.3, xs[0, 4], 0.5) - normal(ys[0, 2], xs[0, 4], 0.5)
    np.testing.assert_allclose(found[1] - found[0], expected, rtol=1e-3)


def test_lorenz96_refuses_a_circle_that_is_too_small():
    with pytest.raises(ValueError, match="dimension is 3 and stride 2"):
        lorenz96(3)
    with pytest.raises(ValueError, match="stride 0"):
        lorenz96(4, stride=0)


@pytest.mark.full
def test_finite_hmm_evidence_is_the_sum_over_paths():
    initial, transition = [0.6, 0.4], [[0.9, 0.1], [0.2, 0.8]]
    emission = [[0.7, 0.2, 0.1], [0.1, 0.3, 0.6]]
    model = finite_hmm(initial, transition, emission).compile()
    ys = np.array([0, 2, 2, 1])
    observations = model.observe({"y": [0, 2, np.nan, 1]})
    paths = np.stack(np.meshgrid(*[[0.0, 1.0]] * 4, indexing="ij"), -1).reshape(-1, 4, 1)
    joint = jax.jit(jax.vmap(lambda xs: model.log_joint(xs, observations)))(paths)
    ys[2] = -1
    filtered, smoothed, increments = forward_backward(initial, transition, emission, ys)
    np.testing.assert_allclose(jax.nn.logsumexp(joint), increments.sum(), rtol=1e-5)
    marginal = np.asarray(jax.nn.softmax(joint)) @ paths[:, :, 0]
    np.testing.assert_allclose(marginal, smoothed[:, 1], rtol=1e-4)
    np.testing.assert_allclose(filtered[-1], smoothed[-1])


@pytest.mark.full
def test_finite_hmm_draws_have_its_probabilities():
    model = finite_hmm().compile()
    keys = jax.random.split(jax.random.key(0), 4000)
    states = jax.jit(jax.vmap(lambda key: model.sample_transition(key, jnp.ones(1))))(keys)[:, 0]
    assert set(np.unique(states)) == {0.0, 1.0}
    assert abs(states.mean() - 0.8) < 5 * np.sqrt(0.16 / 4000)
    symbols = jax.jit(jax.vmap(lambda key: model.sample_observation(key, jnp.zeros(1))["y"]))(keys)
    assert symbols.dtype == jnp.int32
    found = np.bincount(symbols, minlength=3) / 4000
    assert np.abs(found - [0.7, 0.2, 0.1]).max() < 5 * np.sqrt(0.21 / 4000)


def test_finite_hmm_refuses_what_are_no_probabilities():
    with pytest.raises(ValueError, match="emission has rows"):
        finite_hmm(emission=[[0.5, 0.6], [0.5, 0.5]])
    with pytest.raises(ValueError, match="do not fit 2 states"):
        finite_hmm(transition=[[1.0]])


@pytest.mark.full
def test_banana_bends():
    """By quadrature: a is symmetric about 0, b lies below y by the mean of a^2."""
    model = banana().compile()
    observation = model.observe({"y": 1.0})
    density = jax.jit(jax.vmap(lambda x: model.log_initial(x) + model.log_observation(x, observation)))
    axis = np.linspace(-6, 6, 601)
    log_evidence, mean, covariance = moments_on_grid(density, [axis, axis])
    finer = moments_on_grid(density, [np.linspace(-6, 6, 901)] * 2)
    np.testing.assert_allclose(log_evidence, finer[0], atol=1e-4)
    np.testing.assert_allclose(mean, finer[1], atol=1e-3)
    assert abs(mean[0]) < 1e-4
    second = covariance[0, 0] + mean[0] ** 2
    np.testing.assert_allclose(mean[1] + second, 1.0, atol=0.05)
    with pytest.raises(ValueError, match="noise is -1"):
        banana(noise=-1)


@pytest.mark.full
def test_oracles_agree_on_the_evidence():
    """Kalman's evidence is the joint density over the posterior of the whole path, at any path: here by quadrature, T = 1."""
    matrices = linear_gaussian_matrices(2, Q=FULL, R=FULL, P=FULL)
    _, ys = simulate(matrices, 1, seed=1)
    axis = np.linspace(-7, 7, 701)
    log_evidence, mean, covariance = moments_on_grid(
        lambda points: np.array([joint_log_density(matrices, [x], ys) for x in points]), [axis[::7], axis[::7]]
    )
    exact = kalman_filter(matrices, ys)
    np.testing.assert_allclose(log_evidence, exact.log_evidence[0], rtol=1e-6)
    np.testing.assert_allclose(mean, exact.means[0], rtol=1e-6)
    np.testing.assert_allclose(covariance, exact.covariances[0], rtol=1e-6)
