"""Climbs under constraints: never up in cost, to scipy's minima, away from constraints that do not hold, without NaN."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
from precision import DTYPES, precision

from poseppl.kernels import trust_region
from poseppl.kernels.constraints import constraints
from poseppl.kernels.trust_region import climb_modes

DIMENSION, RESIDUALS = 5, 7


@partial(jax.jit, static_argnums=(0, 1), static_argnames="num_steps")
def climb(log_density, curvature, starts, linear, data=(), **settings):
    """Climbs on a density of a state and of data, which is compiled once for all data."""
    return climb_modes(starts, lambda x: log_density(x, *data), lambda x: curvature(x, *data), linear, **settings)


def residuals(x, a, b, target, scale, xp=jnp):
    """Weakly curved, so that the sum of squares has one minimum near 0."""
    return a @ xp.sin(x / scale) + b @ (x / scale) - target


def minus_half_squares(x, *data):
    return -0.5 * jnp.sum(residuals(x, *data) ** 2)


def gauss_newton(x, *data):
    jacobian = jax.jacrev(residuals)(x, *data)
    return jacobian.T @ jacobian


def least_squares_problem(seed):
    """Data of the residuals, and bounds."""
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(RESIDUALS, DIMENSION)) / 4, rng.normal(size=(RESIDUALS, DIMENSION))
    target, scale = rng.normal(size=RESIDUALS) * 2, 10.0 ** rng.uniform(-2, 2, DIMENSION)
    low, high = -rng.uniform(0.1, 1.0, DIMENSION) * scale, rng.uniform(0.1, 1.0, DIMENSION) * scale
    return (a, b, target, scale), low, high


@pytest.mark.full
@pytest.mark.parametrize("dtype", DTYPES)
def test_bounded_least_squares_are_scipys(dtype):
    """SciPy's trf with the same bounds and scales that differ by up to 10^4; some bounds are active in every problem."""
    active = 0
    for seed in range(12):
        data, low, high = least_squares_problem(seed)
        middle = 0.5 * (low + high)
        exact = scipy.optimize.least_squares(
            lambda x, data=data: residuals(x, *data, xp=np),
            middle,
            bounds=(low, high),
            x_scale=high - low,
            xtol=1e-12,
            gtol=1e-12,
        )
        with precision(dtype):
            bounds = constraints(DIMENSION, lower=low, upper=high)
            rng = np.random.default_rng(1000 + seed)
            starts = jnp.asarray(rng.uniform(low, high, (6, DIMENSION)), dtype)
            tolerance = 1e-4 if dtype is np.float32 else 1e-10
            arrays = tuple(jnp.asarray(part, dtype) for part in data)
            climbs = climb(minus_half_squares, gauss_newton, starts, bounds, arrays, tolerance=tolerance)
        assert bool(climbs.converged.all())
        np.testing.assert_allclose(np.asarray(climbs.costs, float), exact.cost, rtol=1e-5, atol=2e-4)
        states = np.asarray(climbs.states, float)
        # curvature of at least 0.1: costs within 1e-4 are states within a few percent of the range
        assert (np.abs(states - exact.x) < (0.05 if dtype is np.float32 else 1e-4) * (high - low)).all()
        assert ((states >= np.asarray(bounds.lower)) & (states <= np.asarray(bounds.upper))).all()
        on_bound = (exact.x < low + 1e-6 * (high - low)) | (exact.x > high - 1e-6 * (high - low))
        assert ((states == np.asarray(bounds.lower)) | (states == np.asarray(bounds.upper)))[:, on_bound].all()
        active += on_bound.sum()
    assert active > 12


def quadratic(x, hessian, centre):
    return -0.5 * (x - centre) @ hessian @ (x - centre)


def given_hessian(x, hessian, centre):
    return hessian


def quadratic_problem(seed):
    """A convex quadratic with bounds and three rows, which pass between its minimum and 0."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(DIMENSION, DIMENSION + 2))
    hessian, centre = root @ root.T, rng.normal(size=DIMENSION) * 2
    rows = rng.normal(size=(3, DIMENSION))
    rows *= np.sign(rows @ centre)[:, None]
    limits = rng.uniform(0.1, 0.6, 3) * (rows @ centre)
    return hessian, centre, rows, limits


@pytest.mark.full
@pytest.mark.parametrize("dtype", DTYPES)
def test_rows_of_a_matrix_are_held_as_scipys_trust_constr_does(dtype):
    active = 0
    for seed in range(12):
        hessian, centre, rows, limits = quadratic_problem(seed)

        def cost(x, hessian=hessian, centre=centre):
            return 0.5 * (x - centre) @ hessian @ (x - centre)

        exact = scipy.optimize.minimize(
            cost,
            np.zeros(DIMENSION),
            jac=lambda x, hessian=hessian, centre=centre: hessian @ (x - centre),
            hess=lambda x, hessian=hessian: hessian,
            method="trust-constr",
            bounds=scipy.optimize.Bounds(-1.5, 1.5),
            constraints=scipy.optimize.LinearConstraint(rows, -np.inf, limits),
            options={"gtol": 1e-10, "xtol": 1e-10, "barrier_tol": 1e-10, "maxiter": 3000},
        )
        with precision(dtype):
            linear = constraints(DIMENSION, lower=-1.5, upper=1.5, rows=rows, limits=limits)
            starts = jnp.asarray(np.random.default_rng(seed).normal(size=(6, DIMENSION)), dtype)
            arrays = jnp.asarray(hessian, dtype), jnp.asarray(centre, dtype)
            climbs = climb(quadratic, given_hessian, starts, linear, arrays, tolerance=1e-5)
        states = np.asarray(climbs.states, float)
        assert (states @ rows.T <= limits + 1e-4).all() and (np.abs(states) <= 1.5).all()
        np.testing.assert_allclose(np.asarray(climbs.costs, float), exact.fun, rtol=2e-3, atol=1e-3)
        active += (rows @ exact.x > limits - 1e-4).sum()
    assert active > 12


def rippled(x):
    """Many local minima, in coordinates of different units."""
    return -jnp.sum(0.02 * (x / jnp.array([1.0, 100.0])) ** 2 - jnp.cos(x / jnp.array([1.0, 100.0])))


def plain_curvature(x):
    return -jax.hessian(rippled)(x)


def test_the_cost_never_rises():
    """From one step to the next, wherever a climb begins; Newton's steps without the trust region do rise."""
    starts = jax.random.normal(jax.random.key(0), (60, 2)) * jnp.array([6.0, 600.0])
    free = constraints(2)
    costs = [climb(rippled, plain_curvature, starts, free, num_steps=steps).costs for steps in (1, 2, 4, 8)]
    costs = [np.asarray(values) for values in (-jax.vmap(rippled)(starts), *costs)]
    for before, after in zip(costs, costs[1:], strict=False):
        assert (after <= before + 1e-5).all()  # rounding between two compilations
    newton = jax.vmap(lambda x: x + jnp.linalg.solve(plain_curvature(x), jax.grad(rippled)(x)))(starts)
    assert (np.asarray(-jax.vmap(rippled)(newton)) > costs[0] + 0.1).any()


@pytest.mark.full
def test_a_climb_ends_in_a_minimum_and_not_in_a_saddle():
    """With the Hessian itself, indefinite at most starts."""
    starts = jax.random.normal(jax.random.key(1), (60, 2)) * jnp.array([6.0, 600.0])
    climbs = climb(rippled, plain_curvature, starts, constraints(2))
    assert bool(climbs.converged.all())
    assert (np.linalg.eigvalsh(np.asarray(climbs.curvatures, float) * [[1.0, 100.0], [100.0, 1e4]]) > 0).all()
    assert np.abs(np.asarray(climbs.gradients) * [1.0, 100.0]).max() < 0.02


@pytest.mark.full
def test_a_start_on_a_constraint_leaves_it_when_the_cost_falls_inward():
    """A cost that falls along the upper bound of one coordinate, and away from that of the other; and from a row."""

    def log_density(x):
        return -0.5 * jnp.sum((x - jnp.array([3.0, -2.0])) ** 2) - 0.4 * (x[0] - 3.0) * (x[1] + 2.0)

    def curvature(x):
        return jnp.array([[1.0, 0.4], [0.4, 1.0]])

    corner = jnp.ones((1, 2))
    bounded = jax.jit(lambda x: climb_modes(x, log_density, curvature, constraints(2, upper=1.0)))(corner)
    np.testing.assert_allclose(bounded.states, [[1.0, -1.2]], atol=1e-3)
    # x + y <= 2 and x - y <= 0 both touch the corner; the first lets go
    rows = constraints(2, rows=[[1.0, 1.0], [1.0, -1.0]], limits=[2.0, 0.0])
    np.testing.assert_allclose(
        jax.jit(lambda x: climb_modes(x, log_density, curvature, rows))(corner).states, [[0.5, 0.5]], atol=1e-3
    )


@pytest.mark.full
def test_holding_every_touched_bound_is_noticed(monkeypatch):
    """A start in a corner would stay there."""
    right = trust_region._on_face

    def stuck(x, gradient, model, face, constraints):
        return right(x, gradient, model, face._replace(upper=x >= constraints.upper), constraints)

    monkeypatch.setattr(trust_region, "_on_face", stuck)
    with pytest.raises(AssertionError):
        test_a_start_on_a_constraint_leaves_it_when_the_cost_falls_inward()


@pytest.mark.full
@pytest.mark.parametrize("dtype", DTYPES)
def test_singular_curvatures_make_no_nan(dtype):
    """A density that knows one combination of three coordinates, one that knows none, and one with a cliff."""
    with precision(dtype):
        row = jnp.array([1.0, 2.0, 0.0])
        starts = jnp.asarray(np.random.default_rng(0).normal(size=(8, 3)), dtype)
        free = constraints(3)
        flat = climb(lambda x: -0.5 * (row @ x - 4.0) ** 2, lambda x: jnp.outer(row, row), starts, free)
        np.testing.assert_allclose(flat.states @ row, 4.0, atol=1e-2)
        nothing = climb(lambda x: 0.0 * x[0], lambda x: jnp.zeros((3, 3), x.dtype), starts, free)
        np.testing.assert_array_equal(nothing.states, starts)

        def cliff(x):
            return jnp.where(x[0] > 0.5, -jnp.inf, -0.5 * jnp.sum((x - 1.0) ** 2))

        stopped = climb(cliff, lambda x: jnp.eye(3, dtype=x.dtype), starts, free)
        over = np.asarray(starts[:, 0]) > 0.5
    for climbs in (flat, nothing, stopped):
        for leaf in jax.tree.leaves(climbs._replace(costs=jnp.zeros(8))):
            assert np.isfinite(np.asarray(leaf, float)).all()
    assert over.any() and not over.all()
    assert np.isinf(np.asarray(stopped.costs)[over]).all() and np.isfinite(np.asarray(stopped.costs)[~over]).all()
    assert not np.asarray(stopped.converged)[over].any()


def identity(x, centre):
    return jnp.eye(2)


@pytest.mark.full
def test_one_compilation_serves_all_data():
    traces = []

    def log_density(x, centre):
        traces.append(1)
        return -0.5 * jnp.sum((x - centre) ** 2)

    counts = []
    for centre in ([0.0, 0.5], [3.0, -1.0]):
        found = climb(log_density, identity, jnp.zeros((4, 2)), constraints(2, upper=1.0), (jnp.array(centre),))
        counts.append(len(traces))
        np.testing.assert_allclose(found.states, np.minimum(np.broadcast_to(centre, (4, 2)), 1.0), atol=1e-3)
        assert (np.asarray(found.evaluations) < 8).all()
    assert counts[0] == counts[1] > 0


@pytest.mark.full
def test_rows_of_another_length_are_refused():
    with pytest.raises(ValueError, match=r"rows have shape \(1, 2\)"):
        constraints(3, rows=[[1.0, 0.0]])
