"""Particle-mGRAD and aGRAD: weights against densities of the joint normal, draws against Kalman; wrong weights are noticed."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from law_problems import problem, z_scores
from oracles.grid import growth_on_grid
from oracles.kalman import rauch_tung_striebel
from poseppl_models.toys.finite_hmm import finite_hmm
from poseppl_models.toys.growth import growth
from precision import precision
from scipy.stats import multivariate_normal
from test_trajectory_smoother import history_of, positive_model

from poseppl.smoothers.published import particle_mgrad
from poseppl.smoothers.published.particle_mgrad import (
    geometry,
    gradient_move,
    log_correction,
    particle_mgrad_smoother,
    propose,
    scale_of,
    shifted,
)

VARIANTS = ("mgrad", "agrad")
CHAINS, DRAWS = 40, 400  # the chains are the replicates that standard errors come from


def log_marginal(n, xs, means, phi, h, scale, noise, u):
    """Log-density of all slots but n by N(u; phi, h S), or given u, with nothing simplified."""
    gain = noise @ np.linalg.inv(noise + h * scale)
    others = [k for k in range(len(xs)) if k != n]
    centre = phi if u is None else u
    mean = np.concatenate([means[k] + gain @ (centre - means[k]) for k in others])
    within = np.kron(np.eye(len(others)), h * gain @ scale)
    shared = np.kron(np.ones((len(others),) * 2), h * gain @ scale @ gain.T) * (u is None)
    own = 0.0 if u is None else multivariate_normal.logpdf(u, phi, h * scale)
    return own + multivariate_normal.logpdf(np.concatenate([xs[k] for k in others]), mean, within + shared)


@pytest.mark.parametrize("variant", VARIANTS)
def test_weights_are_densities_of_the_other_slots(variant):
    rng = np.random.default_rng(3)
    scale, noise = (root @ root.T + 0.2 * np.eye(3) for root in rng.normal(size=(2, 3, 3)))
    xs, means, gradients = rng.normal(size=(3, 4, 3))
    h, u = 0.7, rng.normal(size=3)
    with precision(np.float64):
        axes = geometry(jnp.asarray(scale), jnp.asarray(noise))
        phi = shifted(axes, h, jnp.asarray(xs), jnp.asarray(gradients))
        ours = np.asarray(log_correction(variant, axes, h, axes.whiten @ u, jnp.asarray(xs), jnp.asarray(means), phi))
    kept = u if variant == "agrad" else None
    phis = xs + h * gradients @ scale
    exact = [log_marginal(n, xs, means, phis[n], h, scale, noise, kept) for n in range(4)]
    np.testing.assert_allclose(ours - ours[0], np.array(exact) - exact[0], rtol=1e-9, atol=1e-9)


def test_proposals_have_their_moments():
    noise, scale, h = np.array([[1.0, 0.4], [0.4, 0.5]]), np.array([[0.6, -0.1], [-0.1, 0.3]]), 0.8
    mean, u = np.array([1.0, -2.0]), np.array([0.5, 0.3])
    with precision(np.float64):
        axes = geometry(jnp.asarray(scale), jnp.asarray(noise))
        drawn = np.asarray(propose(jax.random.key(0), axes, h, axes.whiten @ u, jnp.tile(jnp.asarray(mean), (40_000, 1))))
    gain = noise @ np.linalg.inv(noise + h * scale)
    covariance = noise - gain @ noise
    error = np.sqrt(np.diagonal(covariance) / len(drawn))
    assert (np.abs(drawn.mean(0) - mean - gain @ (u - mean)) < 5 * error).all()
    assert (np.abs(np.cov(drawn.T) - covariance) < 5 * np.sqrt(2 / len(drawn)) * np.diagonal(covariance).max()).all()


def chain_means(variant, h=0.5):
    """Means of chains (M, T, d) of moves with 4 particles and proposals that are not the transition's, and the exact ones.

    Chains start at the exact means, so that what is seen is where moves take them, and not how long they need from afar.
    """
    posed = problem()
    num_frames = len(posed.inputs)
    scale, noise = jnp.array([[1.0, 0.3], [0.3, 0.5]]), jnp.asarray(0.7 * posed.matrices.Q, jnp.float32)
    axes = jax.tree.map(lambda leaf: jnp.tile(leaf, (num_frames, *[1] * leaf.ndim)), geometry(scale, noise))
    exact = rauch_tung_striebel(posed.matrices, posed.exact)[0]

    def move(xs, key):
        steps = jnp.full(num_frames, h)
        moved = gradient_move(posed.model, key, xs, posed.observations, posed.inputs, axes, steps, 4, variant)
        return moved, moved

    def chain(key):
        start = jnp.asarray(exact, jnp.float32)
        return jnp.mean(jax.lax.scan(move, start, jax.random.split(key, DRAWS + 50))[1][50:], 0)

    return np.asarray(jax.jit(jax.vmap(chain))(jax.random.split(jax.random.key(5), CHAINS))), exact


@pytest.mark.slow
@pytest.mark.parametrize("variant", VARIANTS)
def test_moves_leave_the_posterior_and_wrong_ones_do_not(variant, monkeypatch):
    draws, exact = chain_means(variant)
    assert np.abs(z_scores(draws, exact)).max() < 5
    monkeypatch.setattr(particle_mgrad, "log_correction", lambda variant, axes, h, u, xs, means, phi: jnp.zeros(len(xs)))
    assert np.abs(z_scores(chain_means(variant)[0], exact)).max() > 10


def bent(variant):
    """Moments (M, 3) of chains for a frame of the growth model, whose likelihood bends, and those of quadrature."""
    model, grid = growth().compile(1.0), growth_on_grid(np.array([3.0]))
    observations, inputs = model.observe({"y": np.array([3.0])}), jnp.ones(1)
    axes = jax.tree.map(lambda leaf: leaf[None], geometry(jnp.full((1, 1), 3.0), jnp.full((1, 1), 5.0)))

    def move(xs, key):
        moved = gradient_move(model, key, xs, observations, inputs, axes, jnp.full(1, 3.0), 4, variant)
        return moved, jnp.stack([moved[0, 0], moved[0, 0] ** 2, moved[0, 0] ** 4])

    def chain(key):
        return jnp.mean(jax.lax.scan(move, jnp.ones((1, 1)), jax.random.split(key, 1050))[1][50:], 0)

    found = np.asarray(jax.jit(jax.vmap(chain))(jax.random.split(jax.random.key(2), CHAINS)))
    return found, np.array([grid[2][0] @ grid[0] ** power for power in (1, 2, 4)])


@pytest.mark.slow
@pytest.mark.parametrize("variant", VARIANTS)
def test_gradients_of_all_slots_are_in_the_weights(variant, monkeypatch):
    assert np.abs(z_scores(*bent(variant))).max() < 5
    monkeypatch.setattr(  # as if the others had none
        particle_mgrad, "shifted", lambda axes, h, xs, gradients: shifted(axes, h, xs, gradients * (xs.ndim == 1))
    )
    assert np.abs(z_scores(*bent(variant))).max() > 8


def exact_trajectories(ys, count):
    """Independent draws (count, T) of the growth model's trajectories, backwards through its grid, anywhere within a cell."""
    rng, (grid, filtered, _, _) = np.random.default_rng(7), growth_on_grid(ys)
    drawn = [rng.choice(grid, count, p=filtered[-1])]
    for t in range(len(ys) - 1, 0, -1):
        means = grid / 2 + 25 * grid / (1 + grid**2) + 8 * np.cos(1.2 * (t + 1))
        chances = np.cumsum(filtered[t - 1] * np.exp(-0.05 * (drawn[0][:, None] - means) ** 2), 1)
        drawn.insert(0, grid[np.sum(chances < rng.random((count, 1)) * chances[:, -1:], 1)])
    return np.stack(drawn, 1) + rng.uniform(-0.5, 0.5, (count, len(ys))) * (grid[1] - grid[0])


def largest_drift(variant, num_moves=5):
    """Standard errors by which moments of exact draws of two modes a frame are others after moves, the largest."""
    ys, model = np.array([5.0, 0.5, 8.0, 2.0]), growth().compile(1.0)
    starts, inputs = exact_trajectories(ys, 4000), jnp.arange(1.0, 5.0)
    axes = jax.tree.map(lambda leaf: jnp.tile(leaf, (4, *[1] * leaf.ndim)), geometry(jnp.eye(1) * 3, jnp.eye(1) * 10))
    observations, h = model.observe({"y": ys}), jnp.full(4, 3.0)
    move = jax.jit(jax.vmap(lambda key, xs: gradient_move(model, key, xs, observations, inputs, axes, h, 4, variant)))
    xs = jnp.asarray(starts, jnp.float32)[..., None]
    for key in jax.random.split(jax.random.key(11), num_moves):
        xs = move(jax.random.split(key, len(xs)), xs)
    before, after = ([x, x**2, x[:, 1:] * x[:, :-1]] for x in (starts, np.asarray(xs, float)[..., 0]))
    drift = np.concatenate(after, 1) - np.concatenate(before, 1)
    return np.abs(drift.mean(0) / (drift.std(0, ddof=1) / np.sqrt(len(drift)))).max()


@pytest.mark.slow  # two programs each
@pytest.mark.parametrize("variant", VARIANTS)
def test_exact_draws_of_two_modes_stay_exact(variant, monkeypatch):
    """However slowly a chain would come from one mode to the other."""
    assert largest_drift(variant) < 4.5
    monkeypatch.setattr(particle_mgrad, "log_correction", lambda variant, axes, h, u, xs, means, phi: jnp.zeros(len(xs)))
    assert largest_drift(variant) > 10


@pytest.mark.full
@pytest.mark.parametrize("scaling", ["covariance", "spread", "none"])
def test_scales_are_positive_where_particles_do_not_differ(scaling):
    particles = jnp.array([[1.0, 2.0, 0.0]] * 3) * jnp.array([[1.0], [2.0], [3.0]])
    for given in (particles, particles[:1]):
        scale = np.asarray(scale_of(scaling, given, jnp.zeros(len(given))))
        assert (np.linalg.eigvalsh(scale) > 0).all()


@pytest.mark.full
def test_bad_settings_and_unsuitable_models_are_reported():
    posed = problem()
    wrong = ({"num_particles": 1}, {"num_chains": 0}, {"num_draws": 0}, {"num_warmup": -1}, {"variant": "a"}, {"scaling": "b"})
    for settings in wrong:
        with pytest.raises(ValueError, match=next(iter(settings))):
            particle_mgrad_smoother(posed.model, **settings)
    with pytest.raises(ValueError, match="particle_gibbs_smoother"):
        particle_mgrad_smoother(finite_hmm([0.5, 0.5], [[0.5, 0.5]] * 2, [[0.5, 0.5]] * 2).compile())
    model = positive_model()
    smoother = particle_mgrad_smoother(model, num_particles=2, num_chains=1, num_draws=1, num_warmup=0)
    with pytest.raises(ValueError, match="rate"):
        smoother.smooth(jax.random.key(0), history_of(jnp.ones((2, 3, 1))), model.observe({"count": np.array([9, 2])}))
