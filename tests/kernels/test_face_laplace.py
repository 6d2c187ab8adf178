"""Masses and moments at the face of active constraints, against exact integrals; modes of known mixtures."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.stats
from precision import DTYPES, precision

from poseppl.kernels import face_laplace
from poseppl.kernels.constraints import constraints
from poseppl.kernels.face_laplace import face_modes
from poseppl.kernels.mode_search import search_modes
from poseppl.kernels.trust_region import climb_modes


def exact_moments(slope, curvature):
    """Integral, mean and variance of exp(-s t - c t^2 / 2) on t >= 0, by quadrature over a range scaled to its width."""
    width = 1.0 / max(slope, np.sqrt(curvature))

    def moment(power):
        def density(t):
            return t**power * np.exp(-slope * t * width - 0.5 * curvature * (t * width) ** 2)

        return scipy.integrate.quad(density, 0, 60, epsabs=0, epsrel=1e-11, limit=200)[0] * width ** (power + 1)

    mass, first, second = (moment(power) for power in range(3))
    return mass, first / mass, second / mass - (first / mass) ** 2


CUTS = [(s, c) for s in (0.0, 0.1, 1.0, 2.9, 3.1, 30.0, 1e4) for c in (0.01, 1.0, 50.0)]


@pytest.mark.full
@pytest.mark.parametrize("dtype", DTYPES)
def test_a_cut_gaussian_is_integrated_however_steep(dtype):
    rtol = 2e-5 if dtype is np.float32 else 1e-7
    with precision(dtype):
        slopes, curvatures = (jnp.asarray(values, dtype) for values in zip(*CUTS, strict=True))
        integrals = np.asarray(face_laplace.log_integral(slopes, curvatures), float)
        means, variances = (np.asarray(part, float) for part in face_laplace.moments(slopes, curvatures))
    for index, (slope, curvature) in enumerate(CUTS):
        mass, mean, variance = exact_moments(slope, curvature)
        assert integrals[index] == pytest.approx(np.log(mass), rel=rtol, abs=rtol)
        assert means[index] == pytest.approx(mean, rel=rtol)
        assert variances[index] == pytest.approx(variance, rel=10 * rtol)


@pytest.mark.full
def test_draws_of_a_cut_gaussian():
    slopes, curvatures = (jnp.asarray(values) for values in zip(*CUTS, strict=True))
    draws = np.asarray(jax.jit(lambda key: face_laplace.draw(key, slopes, curvatures, 20_000))(jax.random.key(0)), float)
    for index, (slope, curvature) in enumerate(CUTS):
        location, scale = -slope / curvature, 1 / np.sqrt(curvature)
        # the tail of the normal, or of its limit where even float64 has none
        tail = scipy.stats.norm(location, scale).logsf
        exact = (lambda t: 1 - np.exp(tail(t) - tail(0))) if slope * scale < 20 else (lambda t: 1 - np.exp(-slope * t))  # noqa: B023
        assert scipy.stats.kstest(draws[:, index], exact).pvalue > 1e-4, (slope, curvature)


def gaussian(seed, dimension):
    """Mean and precision of a Gaussian."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(dimension, dimension + 2))
    return rng.normal(size=dimension), root @ root.T


@jax.jit
def described(mean, matrix, linear, starts):
    """Modes of a Gaussian under constraints: one program for all bounds."""

    def log_density(x):
        return -0.5 * (x - mean) @ matrix @ (x - mean)

    climbs = climb_modes(starts, log_density, lambda x: matrix, linear, tolerance=1e-6)
    return face_modes(climbs, linear)


@pytest.mark.full
@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("shift", [-1.5, -0.2, 0.0, 0.2, 1.5])
def test_the_mass_of_a_gaussian_cut_by_one_bound_is_exact(dtype, shift):
    """Whether its mean lies inside (the bound is not active) or outside (it is); Laplace's own ignores the cut."""
    mean, matrix = gaussian(3, 4)
    spread = np.sqrt(np.linalg.inv(matrix)[0, 0])
    whole = 0.5 * (4 * np.log(2 * np.pi) - np.linalg.slogdet(matrix)[1])
    with precision(dtype):
        linear = constraints(4, upper=np.array([mean[0] + shift * spread, np.inf, np.inf, np.inf]))
        modes = described(jnp.asarray(mean), jnp.asarray(matrix), linear, jnp.zeros((2, 4)))
        moved, covariances = modes.moments()
    assert bool(modes.active[0, 0]) == (shift < 0) or shift == 0.0
    exact = whole + scipy.stats.norm.logcdf(shift)
    np.testing.assert_allclose(np.asarray(modes.log_masses, float), exact, atol=2e-3 if dtype is np.float32 else 1e-6)
    assert abs(exact - whole) > 0.05
    if shift < 0:  # moments of what is left: those of the cut coordinate, and by regression of the others
        cut = scipy.stats.truncnorm(-np.inf, shift, mean[0], spread)
        inverse = np.linalg.inv(matrix)
        gain = inverse[:, 0] / inverse[0, 0]
        np.testing.assert_allclose(moved[0], mean + gain * (cut.mean() - mean[0]), rtol=1e-2, atol=2e-3)
        expected = inverse + np.outer(gain, gain) * (cut.var() - inverse[0, 0])
        np.testing.assert_allclose(covariances[0], expected, rtol=2e-2, atol=2e-3)
        free = np.zeros((4, 4))
        free[1:, 1:] = np.linalg.inv(matrix[1:, 1:])
        np.testing.assert_allclose(modes.covariances[0], free, rtol=1e-3, atol=1e-4)


@pytest.mark.full
def test_a_row_cuts_as_the_bound_of_a_turned_coordinate_does():
    mean, matrix = gaussian(5, 3)
    normal = np.array([0.6, 0.0, -0.8])
    spread = np.sqrt(normal @ np.linalg.inv(matrix) @ normal)
    whole = 0.5 * (3 * np.log(2 * np.pi) - np.linalg.slogdet(matrix)[1])
    for shift in (-1.0, 0.7):
        linear = constraints(3, rows=2.0 * normal[None], limits=2.0 * (normal @ mean + shift * spread))
        modes = described(jnp.asarray(mean), jnp.asarray(matrix), linear, jnp.zeros((1, 3)) - 5.0 * normal)
        assert modes.log_masses[0] == pytest.approx(whole + scipy.stats.norm.logcdf(shift), abs=3e-3)


@pytest.mark.full
@pytest.mark.parametrize("seed", range(6))
def test_a_corner_is_bounded_from_below(seed):
    """Two bounds that both cut: never more than the orthant's probability, and near to it; Laplace's own is far off."""
    mean, matrix = gaussian(seed, 3)
    inverse = np.linalg.inv(matrix)
    upper = mean - np.array([0.8, 0.4, -np.inf]) * np.sqrt(np.diag(inverse))
    whole = 0.5 * (3 * np.log(2 * np.pi) - np.linalg.slogdet(matrix)[1])
    exact = scipy.stats.multivariate_normal(mean[:2], inverse[:2, :2]).logcdf(upper[:2])
    modes = described(jnp.asarray(mean), jnp.asarray(matrix), constraints(3, upper=upper), jnp.asarray(mean - 3.0)[None])
    found = float(modes.log_masses[0]) - whole
    assert found < exact + 5e-3
    both = bool(modes.active[0, :2].all())
    assert found > exact - (0.15 if both else 0.4)
    assert exact < -1.0


def mixture(seed, number=6, dimension=3):
    """Well separated Gaussians of known masses, in coordinates of different units."""
    rng = np.random.default_rng(seed)
    unit = np.array([1.0, 100.0, 0.01])[:dimension]
    means = rng.permutation(np.stack(np.meshgrid(*[[-4.0, 4.0]] * dimension), -1).reshape(-1, dimension))[:number]
    roots = rng.normal(size=(number, dimension, dimension)) / 6 + np.eye(dimension) / 2
    covariances = roots @ roots.transpose(0, 2, 1) * unit[:, None] * unit
    log_weights = np.log(rng.dirichlet(np.full(number, 2.0)))
    means, precisions = means * unit, np.linalg.inv(covariances)
    constants = -0.5 * (dimension * np.log(2 * np.pi) + np.linalg.slogdet(covariances)[1])

    def log_density(x):
        offset = x - means
        terms = log_weights + constants - 0.5 * jnp.einsum("kd,kde,ke->k", offset, jnp.asarray(precisions), offset)
        return jax.nn.logsumexp(terms)

    return log_density, lambda x: -jax.hessian(log_density)(x), means, log_weights, unit


@pytest.mark.full
@pytest.mark.parametrize("seed", range(2))
def test_all_modes_of_a_mixture_are_found_once_with_their_masses(seed):
    log_density, curvature, means, log_weights, unit = mixture(seed)
    starts = jax.random.normal(jax.random.key(seed), (80, 3)) * 4.0 * unit
    found = jax.jit(lambda s: search_modes(s, log_density, curvature, constraints(3), 8))(starts)
    assert int(found.number) == len(means)
    order = np.argsort(-log_weights)
    np.testing.assert_allclose(np.asarray(found.modes.states[:6]) / unit, means[order] / unit, atol=0.05)
    np.testing.assert_allclose(found.modes.log_masses[:6], log_weights[order], atol=0.02)
    assert (np.asarray(found.modes.log_masses[6:]) == -np.inf).all()
    assert float(found.log_mass) == pytest.approx(0.0, abs=0.02)
    few = jax.jit(lambda s: search_modes(s, log_density, curvature, constraints(3), 2))(starts)
    np.testing.assert_allclose(few.modes.log_masses, np.asarray(found.modes.log_masses)[:2], atol=1e-4)
    assert float(few.log_mass) == pytest.approx(0.0, abs=0.02)  # also of modes that were not kept


@pytest.mark.full
def test_bounds_cut_a_mixture_into_its_parts():
    """A bound through the middle of one mode halves it, and moves another one, which lies beyond, to the face."""

    def log_density(x):
        return jax.nn.logsumexp(-0.5 * jnp.stack([(x[0] + 4) ** 2, x[0] ** 2, (x[0] - 9.0) ** 2]))

    starts, linear = jnp.linspace(-6.0, 0.0, 20)[:, None], constraints(1, upper=0.0)
    found = jax.jit(lambda s: search_modes(s, log_density, lambda x: -jax.hessian(log_density)(x), linear, 4))(starts)
    np.testing.assert_allclose(np.sort(np.asarray(found.modes.states[:2, 0])), [-4.0, 0.0], atol=1e-2)
    half = 0.5 * np.sqrt(2 * np.pi)
    np.testing.assert_allclose(np.exp(np.asarray(found.modes.log_masses[:2])), [2 * half, half], rtol=2e-2)


def test_climbs_that_came_to_one_mode_are_one():
    """A narrow mode beside a broad one stays itself, though it lies within a standard deviation of that."""

    def log_density(x):
        return jnp.logaddexp(-0.5 * x[0] ** 2, 1.0 - 0.5 * ((x[0] - 0.8) / 0.01) ** 2)

    starts = jnp.array([[-0.3], [0.0], [0.2], [0.795], [0.8], [0.81]])
    found = jax.jit(lambda s: search_modes(s, log_density, lambda x: -jax.hessian(log_density)(x), constraints(1), 6))(starts)
    assert int(found.number) == 2
    labels = np.asarray(found.labels)
    assert len(set(labels[:3])) == 1 and len(set(labels[3:])) == 1 and labels[0] != labels[3]


@pytest.mark.full
@pytest.mark.parametrize("dtype", DTYPES)
def test_singular_curvatures_and_lost_climbs_have_no_nan(dtype):
    with precision(dtype):
        row = jnp.array([1.0, 2.0, 0.0])

        def log_density(x):
            return jnp.where(x[0] > 4.0, -jnp.inf, -0.5 * (row @ x - 4.0) ** 2)

        starts = jnp.array([[0.0, 0.0, 1.0], [9.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
        # rows that say the same as a bound
        linear = constraints(3, upper=np.array([np.inf, 1.0, np.inf]), rows=[[0.0, 3.0, 0.0]], limits=[3.0])
        found = jax.jit(lambda s: search_modes(s, log_density, lambda x: jnp.outer(row, row), linear, 3))(starts)
    for leaf in jax.tree.leaves(found._replace(modes=found.modes._replace(log_masses=jnp.zeros(3)))):
        assert np.isfinite(np.asarray(leaf, float)).all()
    assert not np.isnan(np.asarray(found.modes.log_masses)).any()
    assert int(found.labels[1]) == 1 and np.isfinite(float(found.log_mass))
