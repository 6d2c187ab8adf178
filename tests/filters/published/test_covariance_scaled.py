"""The tracker of several modes where the answer is known: mirror modes, a bound, an outlier, and a limb seen by one camera."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from oracles.grid import grid_filter_smoother
from poseppl_models.toys.mirror import LEVEL, NOISE, SPREAD, START, mirror, mirror_mean

from poseppl.filters import covariance_scaled_filter
from poseppl.filters.published import mode_mixture
from poseppl.kernels import face_laplace
from poseppl.kernels.constraints import constraints
from poseppl.program import Lorentzian, StateSpaceModel

NUM_FRAMES = 40


def run(built, key, observations):
    """States and infos of all frames."""
    keys = jax.random.split(key, len(jax.tree.leaves(observations)[0]))
    first, rest = (jax.tree.map(lambda leaf, rows=rows: leaf[rows], (keys, observations)) for rows in (0, slice(1, None)))

    def step(state, row):
        state, info = built.step(row[0], state, row[1])
        return state, (state, info)

    begun = built.init(first[0], first[1])
    later = jax.lax.scan(step, begun[0], rest)[1]
    return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), begun, later)


def normal(residual, scale):
    return -0.5 * (residual / scale) ** 2 - np.log(scale * np.sqrt(2 * np.pi))


def mirrored(distances):
    """Share of the particles above 0 (T, N) and evidence (T,), with those of a grid, where no datum tells the side."""
    model = mirror().compile()
    observations = model.observe({"y": distances, "side": np.full(len(distances), np.nan)})
    grid = np.linspace(-9.0, 9.0, 1200)
    exact = grid_filter_smoother(
        grid,
        normal(grid, START),
        lambda t: normal(grid - np.asarray(mirror_mean(grid), float)[:, None], SPREAD),
        normal(distances[:, None] - np.abs(grid), NOISE),
    )
    return model, observations, grid, exact


@pytest.mark.slow
def test_both_mirror_modes_are_carried_with_their_weights():
    """Through 40 frames, each with half of the weight; a tracker of one mode, or of scarce noise, has only one."""
    model, observations, grid, exact = mirrored(np.full(NUM_FRAMES, LEVEL))

    def above(**settings):
        built = covariance_scaled_filter(model, 200, **settings)
        states, _ = jax.jit(jax.vmap(partial(run, built, observations=observations)))(jax.random.split(jax.random.key(0), 10))
        return np.asarray(jnp.mean(states.particles[..., 0] > 0, -1))

    assert (np.abs(above(num_modes=3, num_starts=12) - 0.5) < 0.02).all()
    single = above(num_modes=1, num_starts=1)[:, -1]
    assert ((single < 0.01) | (single > 0.99)).all()


@pytest.mark.full
def test_evidence_is_near_to_the_grids():
    """Modes that lie apart are near to Gaussians: Laplace's approximation is good to a few percent."""
    model, observations, grid, exact = mirrored(LEVEL + 0.4 * np.sin(np.arange(10.0)))
    _, infos = jax.jit(partial(run, covariance_scaled_filter(model, 200, num_modes=3, num_starts=12)))(
        jax.random.key(1), observations=observations
    )
    np.testing.assert_allclose(infos.log_evidence, exact[2], atol=0.1)
    assert np.abs(np.asarray(infos.log_evidence) + np.log(2.0) - exact[2]).min() > 0.3  # as of one of two modes


BOUND = 1.0
DATA = np.array([0.8, 1.3, 1.6, 1.5, 0.9])


def limited():
    """A state that cannot exceed 1, whose data do: the joint is at its limit."""

    def initial(params, inputs):
        numpyro.sample("angle", dist.TruncatedNormal(0.0, 0.5, low=-BOUND, high=BOUND))

    def transition(params, state, inputs):
        numpyro.sample("angle", dist.TruncatedNormal(state["angle"], 0.2, low=-BOUND, high=BOUND))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["angle"], 0.2))

    model = StateSpaceModel(initial, transition, observation).compile()
    grid = np.linspace(-BOUND, BOUND, 2001)

    def cut(mean, scale):
        log_prob = dist.TruncatedNormal(jnp.asarray(mean)[:, None], scale, low=-BOUND, high=BOUND).log_prob(grid)
        return np.asarray(log_prob, float)

    likelihoods = normal(DATA[:, None] - grid, 0.2)
    exact = grid_filter_smoother(grid, cut([0.0], 0.5)[0], lambda t: cut(grid, 0.2), likelihoods)
    return model, model.observe({"y": DATA}), grid, exact


@pytest.mark.slow
def test_a_joint_at_its_limit_stays_inside_of_it():
    """Means within a small part of the data's noise of the grid's; particles keep to the bound, and are spread along it."""
    model, observations, grid, exact = limited()
    built = covariance_scaled_filter(model, 2000, num_modes=2, num_starts=4)
    states, infos = jax.jit(partial(run, built))(jax.random.key(2), observations=observations)
    angles = np.asarray(jax.vmap(jax.vmap(lambda x: model.to_sites(x)["angle"]))(states.particles), float)
    mean = exact[0] @ grid
    sd = np.sqrt(exact[0] @ grid**2 - mean**2)
    assert (np.abs(angles) < BOUND).all() and not np.asarray(infos.failed).any()
    np.testing.assert_allclose(angles.mean(1), mean, atol=0.06)
    np.testing.assert_allclose(angles.std(1), sd, rtol=0.4)
    pinned = np.asarray(states.modes.means)[2, 0, 0]
    assert BOUND - 0.3 < pinned < BOUND


@pytest.mark.slow
def test_a_limit_may_be_given_as_constraints_too():
    """On a state over the real line; without it the tracker follows the data beyond."""

    def walk(params, *before_and_inputs):
        before = before_and_inputs[0]["angle"] if len(before_and_inputs) == 2 else 0.0
        numpyro.sample("angle", dist.Normal(before, 0.5))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["angle"], 0.2))

    model = StateSpaceModel(walk, walk, observation).compile()
    observations = model.observe({"y": DATA})
    free, kept = (
        jax.jit(partial(run, covariance_scaled_filter(model, 300, num_modes=2, num_starts=4, limits=limits)))(
            jax.random.key(3), observations=observations
        )[0].particles
        for limits in (None, constraints(1, upper=BOUND))
    )
    assert float(free.max()) > 1.5 and float(kept.max()) <= BOUND


@pytest.mark.slow
def test_a_cut_density_that_ignores_its_slope_is_noticed(monkeypatch):
    """Draws of half a Gaussian at the bound lie too far inside."""
    real = face_laplace.draw
    monkeypatch.setattr(
        mode_mixture.face_laplace, "draw", lambda key, slope, curvature, num: real(key, 0.0 * slope, 1e-2 * curvature, num)
    )
    with pytest.raises(AssertionError):
        test_a_joint_at_its_limit_stays_inside_of_it()


@pytest.mark.slow
def test_a_robust_single_mode_ignores_what_leads_a_gaussian_astray():
    """One mode with squared errors and one with Lorentzian ones, an outlier in every other frame."""

    def walk(params, *before_and_inputs):
        before = before_and_inputs[0]["x"] if len(before_and_inputs) == 2 else jnp.zeros(2)
        numpyro.sample("x", dist.Normal(before, 0.3))

    def seen(robust):
        def observation(params, state, inputs):
            errors = dist.Normal(jnp.tile(state["x"], (3, 1)), 0.2).to_event(1)
            numpyro.sample("y", Lorentzian(errors, 4.0) if robust else errors)

        return observation

    rng = np.random.default_rng(0)
    truth = np.cumsum(rng.normal(size=(12, 2)) * 0.2, 0)
    data = truth[:, None] + rng.normal(size=(12, 3, 2)) * 0.2
    data[::2, 0] += 8.0
    errors = []
    for robust in (True, False):
        model = StateSpaceModel(walk, walk, seen(robust)).compile()
        built = covariance_scaled_filter(model, 100, num_modes=1, num_starts=1)
        states, _ = jax.jit(partial(run, built))(jax.random.key(4), observations=model.observe({"y": data}))
        errors.append(np.linalg.norm(np.asarray(states.modes.means)[:, 0] - truth, axis=-1).mean())
    assert errors[0] < 0.25 < 1.0 < errors[1]


@pytest.mark.full
def test_settings_out_of_range_are_refused():
    model = mirror().compile()
    for settings, words in (
        ({"num_modes": 7, "num_starts": 3}, "num_starts is 3. Expected at least 7"),
        ({"stretch": 0.0}, "stretch is 0.0. Expected a positive number"),
        ({"sampling": "axes"}, "sampling is 'axes'. Expected one of covariance"),
        ({"prior": "best"}, "prior is 'best'. Expected one of closest, mixture"),
    ):
        with pytest.raises(ValueError, match=words):
            covariance_scaled_filter(model, **settings)
