"""Whole-trajectory smoothing: its curvature and its mode exactly, its draws against quadrature."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from law_problems import independent, problem, z_scores
from oracles.quadrature import moments_on_grid
from poseppl_models.toys.finite_hmm import finite_hmm
from precision import precision

from poseppl.program import StateSpaceModel
from poseppl.smoothers.backward_pass import initial_trajectories
from poseppl.smoothers.base import History, effective_draws_by_frame
from poseppl.smoothers.curvature import find_mode, trajectory_precisions
from poseppl.smoothers.trajectory import trajectory_smoother


def positive_model():
    """A positive state with a heavy-tailed transition: no Gaussian moments anywhere."""

    def initial(params, inputs):
        numpyro.sample("rate", dist.Gamma(3.0, 1.0))

    def transition(params, state, inputs):
        moved = dist.TransformedDistribution(dist.StudentT(5.0, jnp.log(state["rate"]), 0.5), dist.transforms.ExpTransform())
        numpyro.sample("rate", moved)

    def observation(params, state, inputs):
        numpyro.sample("count", dist.Poisson(state["rate"]))

    return StateSpaceModel(initial, transition, observation).compile()


def history_of(particles):
    """Equally weighted particles (T, N, d)."""
    num_frames, num, _ = particles.shape
    ancestors = jnp.tile(jnp.arange(num, dtype=jnp.int32), (num_frames, 1))
    return History(particles, jnp.full((num_frames, num), -jnp.log(num)), ancestors, jnp.zeros(num_frames, bool))


@pytest.mark.full
def test_curvature_of_a_linear_model_is_its_hessian_and_one_step_reaches_the_mode():
    with precision(np.float64):
        posed = problem()
        model, observations, inputs = posed.model, posed.observations, posed.inputs

        @jax.jit
        def run(xs):
            def log_density(xs):
                return model.log_joint(xs, observations, inputs)

            mode = find_mode(model, xs, observations, inputs, 1)
            return (
                trajectory_precisions(model, observations, inputs)(xs),
                jax.hessian(log_density)(xs),
                jax.grad(log_density)(mode),
            )

        xs = np.random.default_rng(0).normal(size=(5, 2))
        curvature, hessian, gradient = run(jnp.asarray(xs))
        blocks = -np.asarray(hessian).transpose(0, 2, 1, 3)
        index = np.arange(5)
        np.testing.assert_allclose(curvature.diagonal, blocks[index, index], atol=1e-9)
        np.testing.assert_allclose(curvature.below, blocks[index[1:], index[:-1]], atol=1e-9)
        np.testing.assert_allclose(gradient, 0.0, atol=1e-10)


def test_curvature_of_a_bent_walk_is_that_of_where_it_is():
    def initial(params, inputs):
        numpyro.sample("x", dist.Normal(0.0, 1.0))

    def transition(params, state, inputs):
        numpyro.sample("x", dist.Normal(jnp.sin(state["x"]), 0.5))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["x"], 1.0))

    with precision(np.float64):
        model = StateSpaceModel(initial, transition, observation).compile()
        xs = np.array([0.5, -1.0, 2.0])
        curvature = trajectory_precisions(model, model.observe({"y": np.zeros(3)}), None)(jnp.asarray(xs[:, None]))
        slopes = np.cos(xs[:-1])
        np.testing.assert_allclose(curvature.below[:, 0, 0], -4 * slopes, rtol=1e-9)
        np.testing.assert_allclose(curvature.diagonal[:, 0, 0], [2 + 4 * slopes[0] ** 2, 5 + 4 * slopes[1] ** 2, 5], rtol=1e-9)


@pytest.mark.parametrize("kernel", ["nuts", "hmc"])
@pytest.mark.slow
def test_a_model_without_gaussian_moments_agrees_with_quadrature(kernel):
    model = positive_model()
    observations = model.observe({"count": np.array([9, 2])})
    grid = np.linspace(-3.5, 4.5, 161)

    def density(points):
        return jax.vmap(lambda xs: model.log_joint(xs, observations))(points.reshape(-1, 2, 1))

    _, mean, covariance = moments_on_grid(lambda points: jax.jit(density)(jnp.asarray(points)), (grid, grid))
    smoother = trajectory_smoother(model, num_chains=2, num_draws=150, num_warmup=50, kernel=kernel, num_curvatures=8)
    history = history_of(jax.random.normal(jax.random.key(1), (2, 50, 1)))

    def one(rng_key):
        smoothed = smoother.smooth(rng_key, history, observations)
        xs = smoothed.particles.reshape(2, -1).T
        centred = xs - mean
        return jnp.mean(xs, 0), centred.T @ centred / len(xs), smoothed.info

    means, seconds, info = independent(one, 20)
    assert np.abs(z_scores(np.asarray(means), mean)).max() < 5
    assert np.abs(z_scores(np.asarray(seconds), covariance)).max() < 5
    assert np.abs(z_scores(np.asarray(means), mean + [0.06, 0.0])).max() > 5
    assert 0.6 < float(info.acceptance.mean()) < 0.97
    assert (np.asarray(info.ess) > 20).all()


@pytest.mark.full
def test_one_frame_and_one_draw():
    with precision(np.float64):
        model = positive_model()
        observations = model.observe({"count": np.array([4])})
        smoother = trajectory_smoother(model, num_chains=3, num_draws=1, num_warmup=0, num_mode_steps=0, num_curvatures=1)
        smoothed = jax.jit(smoother.smooth)(jax.random.key(0), history_of(jnp.ones((1, 2, 1))), observations)
    assert smoothed.particles.shape == (1, 3, 1, 1)
    assert smoothed.particles.dtype == np.float64
    assert np.isfinite(smoothed.particles).all()
    assert np.asarray(smoothed.info.ess).tolist() == [3.0]


@pytest.mark.full
def test_starts_stay_in_the_branch_that_they_begin_in():
    model = problem().model
    rng = np.random.default_rng(0)
    sign = rng.choice([-1.0, 1.0], (5, 600))
    particles = jnp.asarray(1e3 * sign[:, :, None] * 0.9 ** np.arange(5)[:, None, None] * np.array([1.0, 0.5]))
    inputs = jnp.zeros((5, 1))
    drawn = jax.jit(lambda key: initial_trajectories(model, key, history_of(particles), inputs, 40))(jax.random.key(0))
    signs = np.sign(np.asarray(drawn)[:, :, 0])
    assert drawn.shape == (40, 5, 2)
    assert (signs == signs[:, :1]).all()
    assert 5 < (signs[:, 0] > 0).sum() < 35


@pytest.mark.full
def test_effective_draws_tell_independent_draws_from_repeated_ones():
    draws = jax.random.normal(jax.random.key(0), (3, 4, 200, 2))
    repeated = jnp.repeat(draws[:, :, :20], 10, axis=2)
    independent, few = effective_draws_by_frame(draws), effective_draws_by_frame(repeated)
    assert (np.asarray(independent) > 500).all()
    assert (np.asarray(few) < 200).all()
    assert np.asarray(effective_draws_by_frame(jnp.ones_like(draws))).tolist() == [1.0, 1.0, 1.0]


@pytest.mark.full
def test_bad_settings_are_reported():
    model = positive_model()
    for settings in (
        {"num_chains": 0},
        {"num_draws": 0},
        {"kernel": "mala"},
        {"target_acceptance": 1.0},
        {"num_mode_steps": -1},
    ):
        with pytest.raises(ValueError, match=next(iter(settings))):
            trajectory_smoother(model, **settings)
    with pytest.raises(ValueError, match="particle_gibbs_smoother"):
        trajectory_smoother(finite_hmm().compile())
