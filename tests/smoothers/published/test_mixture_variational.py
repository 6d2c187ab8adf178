"""Variational smoothing on mixtures that are known: exact where it has to be, its free energy a bound that never rises."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mixture_problems import exact_smoothing, joint_prior, mixture_problem
from poseppl_models.toys.growth import growth

from poseppl.gaussians.block_tridiagonal import marginal_covariances
from poseppl.gaussians.linear_transitions import transition_structure
from poseppl.smoothers import History
from poseppl.smoothers.published import mixture_variational
from poseppl.smoothers.published.likelihood_mixture import mixture_of_gaussians
from poseppl.smoothers.published.mixture_variational import fit_variational, mixture_variational_smoother


def particles_around(centres, num_particles=50, seed=0):
    """A history whose particles scatter around the states (T, d)."""
    num_frames, dimension = np.shape(centres)
    noise = np.random.default_rng(seed).normal(size=(num_frames, num_particles, dimension))
    shape = (num_frames, num_particles)
    return History(
        jnp.asarray(np.asarray(centres)[:, None] + noise),
        jnp.full(shape, -np.log(num_particles)),
        jnp.zeros(shape, jnp.int32),
        jnp.zeros(num_frames, bool),
    )


def fit(posed, num_rounds, factorised=False, centre=0.0):
    history = particles_around(np.full(posed.means[:, 0].shape, centre))
    run = jax.jit(lambda: fit_variational(posed.model, history, posed.mixture, posed.inputs, num_rounds, factorised=factorised))
    fitted = run()
    return fitted, np.asarray(marginal_covariances(fitted.factor).own)


@pytest.mark.full
def test_structure_is_read_from_the_program():
    posed = mixture_problem()
    assert transition_structure(posed.model, posed.inputs).linear
    structure = transition_structure(growth().compile(1.0), jnp.arange(1.0, 4.0))
    assert structure.constant
    assert not structure.affine


def test_one_component_is_the_exact_smoother_after_one_round():
    with jax.enable_x64(True):
        posed = mixture_problem(num_frames=4, num_components=1)
        fitted, covariances = fit(posed, 1)
        exact = exact_smoothing(posed)
        whole = exact.covariance.reshape(4, 2, 4, 2)
        np.testing.assert_allclose(fitted.means, exact.means, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(covariances, whole[range(4), :, range(4)], rtol=1e-9, atol=1e-10)
        beside = marginal_covariances(fitted.factor).next
        np.testing.assert_allclose(beside, whole[range(1, 4), :, range(3)], rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(fitted.free_energy[-1], -exact.log_evidence, rtol=1e-9)


@pytest.mark.full
def test_inputs_of_the_wrong_frame_are_noticed():
    with jax.enable_x64(True):
        posed = mixture_problem(num_frames=4, num_components=1)
        shifted = posed._replace(inputs=jnp.roll(posed.inputs, 1, axis=0))
        fitted, _ = fit(shifted, 1)
        assert np.abs(fitted.means - exact_smoothing(posed).means).max() > 0.1


@pytest.mark.full
def test_factorised_over_frames_has_the_exact_means_and_conditional_variances():
    """The best product of Gaussians for a Gaussian has its means, and the inverse blocks of the precision."""
    with jax.enable_x64(True):
        posed = mixture_problem(num_frames=4, num_components=1)
        fitted, covariances = fit(posed, 60, factorised=True)
        exact = exact_smoothing(posed)
        blocks = np.linalg.inv(exact.covariance).reshape(4, 2, 4, 2)[range(4), :, range(4)]
        np.testing.assert_allclose(fitted.means, exact.means, rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(covariances, np.linalg.inv(blocks), rtol=1e-9)


@pytest.mark.parametrize("factorised", [False, True])
def test_free_energy_never_rises_and_bounds_the_evidence(factorised):
    with jax.enable_x64(True):
        posed = mixture_problem(num_frames=5, num_components=3, separation=1.5)
        fitted, covariances = fit(posed, 40, factorised, centre=-2.0)
        energy = np.asarray(fitted.free_energy)
        assert (np.diff(energy) <= 1e-10 * np.abs(energy).max()).all()
        assert energy[-1] >= -exact_smoothing(posed).log_evidence
        assert energy[-2] - energy[-1] < 1e-6
        np.testing.assert_allclose(np.asarray(fitted.responsibilities).sum(1), 1.0)
        np.testing.assert_allclose(energy[-1], free_energy_by_hand(posed, fitted, covariances, factorised), rtol=1e-8)


def free_energy_by_hand(posed, fitted, covariances, factorised):
    """E_q[log q(x) q(s) - log p(x, s, z)] from dense matrices."""
    num_frames, num_components, d = posed.means.shape
    means, shares = np.asarray(fitted.means), np.asarray(fitted.responsibilities)
    whole = np.zeros((num_frames, d, num_frames, d))
    beside = np.asarray(marginal_covariances(fitted.factor).next)
    for t in range(num_frames):
        whole[t, :, t] = covariances[t]
        if t and not factorised:
            whole[t, :, t - 1], whole[t - 1, :, t] = beside[t - 1], beside[t - 1].T
    prior_mean, prior_covariance = joint_prior(posed.matrices, np.asarray(posed.inputs))
    precision = np.linalg.inv(prior_covariance)
    offset = means.ravel() - prior_mean
    size = num_frames * d
    # only blocks next to the diagonal of q's covariance meet the prior's precision
    energy = 0.5 * (offset @ precision @ offset + np.sum(precision * whole.reshape(size, size)))
    energy += 0.5 * (np.linalg.slogdet(prior_covariance)[1] + size * np.log(2 * np.pi))
    energy -= 0.5 * (size * (1 + np.log(2 * np.pi)) - float(fitted.factor.log_det))
    for t in range(num_frames):
        for k in range(num_components):
            residual, noise = means[t] - posed.means[t, k], posed.covariances[t, k]
            inverse = np.linalg.inv(noise)
            expected = np.log(posed.weights[t, k]) - 0.5 * (
                residual @ inverse @ residual
                + np.trace(inverse @ covariances[t])
                + np.linalg.slogdet(noise)[1]
                + d * np.log(2 * np.pi)
            )
            share = shares[t, k]
            energy += share * (np.log(share) - expected) if share > 0 else 0.0
    return energy


@pytest.mark.full
@pytest.mark.parametrize("factorised", [False, True])
def test_updates_that_overshoot_are_noticed(factorised, monkeypatch):
    """Means that go 2.5 times as far as they should end farther from the best ones than they were."""
    original = mixture_variational._target

    def too_far(*arguments):
        target, gradient = original(*arguments)
        return target, 2.5 * gradient

    monkeypatch.setattr(mixture_variational, "_target", too_far)
    with jax.enable_x64(True):
        fitted, _ = fit(mixture_problem(num_frames=5, num_components=3, separation=1.5), 10, factorised, centre=-2.0)
    assert (np.diff(np.asarray(fitted.free_energy)) > 1e-3).any()


@pytest.mark.full
@pytest.mark.parametrize("factorised", [False, True])
def test_free_energy_never_rises_with_a_curved_transition(factorised):
    """The growth model, likelihoods with two modes a frame, q started on the wrong side."""
    num_frames = 8
    with jax.enable_x64(True):
        model = growth().compile(1.0)
        times = jnp.arange(1.0, num_frames + 1)
        roots = np.abs(np.random.default_rng(0).normal(8, 3, num_frames))
        means = np.stack([roots, -roots], 1)[:, :, None]
        mixture = mixture_of_gaussians(np.full((num_frames, 2), np.log(0.5)), means, np.full((num_frames, 2, 1, 1), 1.5))
        history = particles_around(-roots[:, None])
        fitted = jax.jit(lambda: fit_variational(model, history, mixture, times, 30, factorised=factorised))()
    energy = np.asarray(fitted.free_energy)
    assert np.isfinite(energy).all()
    assert (np.diff(energy) <= 1e-10 * np.abs(energy).max()).all()
    assert energy[-1] < energy[0] - 1
    np.testing.assert_allclose(np.asarray(fitted.responsibilities).max(1), 1.0, atol=1e-3)


@pytest.mark.full
@pytest.mark.parametrize("settings", [{"num_rounds": 0}, {"num_draws": 0}, {"num_components": 0}])
def test_numbers_out_of_range_are_refused(settings):
    with pytest.raises(ValueError, match="at least 1"):
        mixture_variational_smoother(mixture_problem().model, **settings)
