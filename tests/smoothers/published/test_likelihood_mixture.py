"""Mixtures of a likelihood: the algebra exactly, and what each correction for the density of particles comes to."""

from __future__ import annotations

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats
from law_problems import MASKED, independent, problem, run
from precision import precision

from poseppl.filters import particle_filter
from poseppl.gaussians.mixture import GaussianMixture
from poseppl.gaussians.weighted_em import choose_seeds, fit_fixed, fit_free
from poseppl.smoothers import History
from poseppl.smoothers.published.likelihood_mixture import (
    MixtureSettings,
    _default_scales,
    _divide,
    _fit_frame,
    _Frame,
    fit_likelihood_mixture,
    log_components,
    mixture_of_gaussians,
)

POSED = problem()


def weighted_points(count=200, dimension=2, seed=0):
    rng = np.random.default_rng(seed)
    points = np.concatenate([rng.normal(-2, 0.5, (count // 2, dimension)), rng.normal(1, 1.0, (count // 2, dimension))])
    weights = rng.gamma(1.0, size=count)
    return jnp.asarray(points), jnp.asarray(weights / weights.sum())


@pytest.mark.full
def test_components_of_a_known_mixture():
    weights, means = np.array([[0.3, 0.7]]), np.array([[[1.0, 2.0], [-1.0, 0.5]]])
    covariances = np.array([[[[1.0, 0.3], [0.3, 2.0]], [[0.5, 0.0], [0.0, 0.1]]]])
    mixture = jax.tree.map(lambda a: a[0], mixture_of_gaussians(np.log(weights), means, covariances))
    x = np.array([0.2, -0.4])
    expected = [
        np.log(w) + scipy.stats.multivariate_normal.logpdf(x, m, c)
        for w, m, c in zip(weights[0], means[0], covariances[0], strict=True)
    ]
    np.testing.assert_allclose(log_components(mixture, jnp.asarray(x)), expected, rtol=1e-4)


@pytest.mark.full
def test_seeds_are_at_or_above_the_average():
    weights = jnp.asarray([0.05, 0.3, 0.15, 0.25, 0.25])
    index, alive = choose_seeds(jax.random.key(0), jnp.log(weights), 4)
    assert alive.tolist() == [True, True, True, False]
    assert set(np.asarray(index)[:3].tolist()) == {1, 3, 4}
    uniform = jnp.full(5, jnp.log(0.2))
    assert bool(choose_seeds(jax.random.key(0), uniform, 5)[1].all())
    index, alive = choose_seeds(jax.random.key(0), uniform, 7)
    assert index.shape == (7,)
    assert int(alive.sum()) == 5


@pytest.mark.full
def test_one_free_component_is_the_weighted_mean_and_covariance():
    points, weights = weighted_points()
    fitted = fit_free(points, weights, jnp.array([3]), jnp.array([True]), 3, jnp.zeros(2))
    mean = np.asarray(weights) @ np.asarray(points)
    np.testing.assert_allclose(fitted.means[0], mean, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(fitted.covariances[0], np.cov(points.T, aweights=weights, ddof=0), rtol=1e-4)


@pytest.mark.full
@pytest.mark.parametrize("free", [False, True])
def test_expectation_maximisation_never_lowers_the_likelihood_of_the_points(free):
    """Free covariances are shrunk, so that only the first rounds are sure to gain."""
    points, weights = weighted_points()
    seeds, alive = jnp.array([10, 150, 60, 0]), jnp.array([True, True, True, False])
    gained = []
    for num_steps in (1, 2, 6):
        if free:
            fitted = fit_free(points, weights, seeds, alive, num_steps, jnp.zeros(2))
        else:
            fitted = fit_fixed(points, weights, seeds, alive, jnp.array([0.5, 0.7]), num_steps)
        terms = [
            np.asarray(fitted.log_weights)[k]
            + scipy.stats.multivariate_normal.logpdf(points, fitted.means[k], fitted.covariances[k if free else 0])
            for k in range(3)
        ]
        gained.append(np.asarray(weights) @ np.logaddexp.reduce(terms))
        assert fitted.log_weights[3] == -np.inf
        assert np.isfinite(np.asarray(fitted.means)).all()
    assert (np.diff(gained) > -1e-6).all()


@cache
def mixtures(correction, num_replicates=40):
    """Mixtures of one free component, of independent filters."""
    settings = MixtureSettings(1, "free", correction=correction, num_steps=2)
    built = particle_filter(POSED.model, 1000)

    def one(rng_key):
        key_filter, key_fit = jax.random.split(rng_key)
        states, infos = run(built, key_filter, POSED.observations, POSED.inputs)
        history = History(states.particles, states.log_weights, infos.ancestors, infos.failed)
        return fit_likelihood_mixture(key_fit, POSED.model, history, POSED.observations, POSED.inputs, settings)

    return independent(one, num_replicates)


def information_of_the_data():
    """H^T R^-1 H and H^T R^-1 y of every frame."""
    values, mask = np.asarray(POSED.observations.values["y"], float), np.asarray(POSED.observations.mask["y"])
    precisions, gradients = [], []
    for y, seen in zip(values, mask, strict=True):
        H = POSED.matrices.H[seen]
        gain = H.T @ np.linalg.inv(POSED.matrices.R[np.ix_(seen, seen)])
        precisions.append(gain @ H)
        gradients.append(gain @ y[seen])
    return np.array(precisions), np.array(gradients)


def information_scores(correction):
    """z-scores of precisions and gradients at 0 against those of the data, at frames with data."""
    fitted = mixtures(correction)
    curvatures = np.asarray(fitted.precisions[:, :, 0], float)
    gradients = np.asarray(fitted.gradients[:, :, 0], float)
    gradients = gradients + np.einsum("rtij,rtj->rti", curvatures, np.asarray(fitted.anchors[:, :, 0], float))
    seen = np.arange(5) != MASKED
    scores = []
    for found, expected in zip((curvatures, gradients), information_of_the_data(), strict=True):
        found, expected = found[:, seen], expected[seen]
        error = found.std(0, ddof=1) / np.sqrt(len(found))
        scores.append(np.abs((found.mean(0) - expected) / error).max())
    return scores


@pytest.mark.full
def test_one_component_without_the_prediction_is_the_likelihood():
    """N = 1000 and 40 replicates: the bias of an inverse variance, about 2 / ESS, is below two of the standard errors."""
    assert max(information_scores("moments")) < 5


@pytest.mark.full
def test_density_of_particles_that_is_left_in_is_noticed():
    assert min(information_scores("none")) > 20


@pytest.mark.full
def test_weights_over_density_stand_for_the_likelihood():
    """If the likelihood is bounded in all directions: the first frame, whose mean is that of both data."""
    fitted = mixtures("weights")
    expected = np.linalg.solve(*(a[0] for a in information_of_the_data()))
    found = np.asarray(fitted.anchors[:, 0, 0], float)
    error = found.std(0, ddof=1) / np.sqrt(len(found))
    assert np.abs((found.mean(0) - expected) / error).max() < 5
    paper = np.asarray(mixtures("none").anchors[:, 0, 0], float)
    assert np.abs((paper.mean(0) - expected) / (paper.std(0, ddof=1) / np.sqrt(len(paper)))).max() > 10


@pytest.mark.full
@pytest.mark.parametrize("correction", ["none", "moments", "weights"])
def test_frame_without_data_is_flat(correction):
    fitted = mixtures(correction)
    assert (np.asarray(fitted.precisions[:, MASKED]) == 0).all()
    assert (np.asarray(fitted.gradients[:, MASKED]) == 0).all()


@pytest.mark.full
@pytest.mark.parametrize(
    ("dtype", "covariance", "num_particles"), [(np.float32, "fixed", 1), (np.float32, "free", 3), (np.float64, "free", 1)]
)
def test_particles_that_are_all_equal_leave_no_nan(dtype, covariance, num_particles):
    with precision(dtype):
        posed = problem()
        particles = jnp.broadcast_to(jnp.array([0.3, -0.2]), (5, num_particles, 2))
        log_weights = jnp.full((5, num_particles), -jnp.log(float(num_particles)))
        history = History(particles, log_weights, jnp.zeros((5, num_particles), jnp.int32), jnp.zeros(5, bool))
        settings = MixtureSettings(4, covariance)
        fit = jax.jit(lambda key: fit_likelihood_mixture(key, posed.model, history, posed.observations, posed.inputs, settings))
        fitted = fit(jax.random.key(0))
        values = jax.vmap(log_components)(fitted, particles[:, 0])
    assert not any(np.isnan(np.asarray(leaf)).any() for leaf in fitted)
    assert all(leaf.dtype == dtype for leaf in fitted)
    assert np.isfinite(np.asarray(values).max(1)).all()


@pytest.mark.parametrize(
    ("settings", "match"),
    [
        ({"num_components": 0}, "num_components is 0"),
        ({"num_steps": 0}, "num_steps is 0"),
        ({"covariance": "full"}, "one of fixed, free"),
        ({"correction": "all"}, "none, weights, moments"),
    ],
)
def test_settings_out_of_range_are_refused(settings, match):
    with pytest.raises(ValueError, match=match):
        MixtureSettings(**settings).check()


def test_a_precision_is_shrunk_by_the_square_of_its_gain():
    """James and Stein: a relative variance of 0.9 takes a tenth off a gain of 3, and all of one of 0.5."""
    for variance, left in ((1 / 4, 3 * 0.9), (1 / 1.5, 0.0)):
        components = GaussianMixture(*(jnp.asarray(part) for part in ([0.0], [[1.0]], [[[variance]]])))
        divided = _divide(components, jnp.zeros(1), jnp.eye(1), jnp.asarray(0.9))
        np.testing.assert_allclose(divided.precisions, [[[left]]], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("dimension", [1, 4])
def test_widths_of_components_are_silvermans(dimension):
    """As SciPy's density estimate has them for as many points as there are components; never wider than the particles."""
    alive, unit = jnp.arange(12) < 9, jnp.arange(1.0, dimension + 1)
    points = np.random.default_rng(0).normal(size=(dimension, 9))
    factor = scipy.stats.gaussian_kde(points, "silverman").factor
    np.testing.assert_allclose(_default_scales(alive, unit), factor * np.asarray(unit), rtol=1e-5)
    np.testing.assert_allclose(
        _default_scales(jnp.arange(12) < 1, unit), np.minimum((4 / (dimension + 2)) ** (1 / (dimension + 4)), 1) * unit
    )


@pytest.mark.full
def test_a_precision_that_chance_may_have_made_is_shrunk():
    """20 particles, with 0.6 of the prediction's variance: a sample variance has the relative variance 2 / N."""
    particles = np.random.default_rng(1).normal(size=(20, 1))
    particles = 1.0 + (particles - particles.mean()) / particles.std() * np.sqrt(0.6 * 4.0)
    frame = _Frame(
        jax.random.key(0),
        jnp.asarray(particles),
        jnp.full(20, -jnp.log(20.0)),
        jnp.zeros(1),
        jnp.full((1, 1), 4.0),
        jnp.array(True),
    )
    found = _fit_frame(frame, MixtureSettings(num_components=1, covariance="free"))
    gain = 1 / 0.6 - 1
    shrink = 1 - (2 / 20) / gain**2
    np.testing.assert_allclose(found.precisions[0, 0, 0], shrink * gain / 4.0, rtol=1e-3)
    np.testing.assert_allclose(found.gradients[0, 0], shrink * 1.0 / 4.0, rtol=1e-3)
