"""A diffuse start and data without noise against formulas in double precision: Durbin and Koopman's, and least squares."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

import poseppl
from poseppl.compilation import double_precision
from poseppl.errors import UnsuitableModelError
from poseppl.gaussians.diffuse import UNKNOWN, DiffuseGaussian, condition_exactly
from poseppl.gaussians.gaussian import Linear
from poseppl.smoothers.rauch_tung_striebel import rauch_tung_striebel_smoother, smoothed_moments

KEY = jax.random.key(0)
exactly = jax.jit(condition_exactly)
A = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.2, 0.0, 0.7]])
Q = np.array([[0.3, 0.1, 0.0], [0.1, 0.2, 0.0], [0.0, 0.0, 0.5]])
H = np.array([[1.0, 0.0, 0.5], [2.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
R = np.array([[0.4, 0.2, 0.0], [0.2, 0.5, 0.1], [0.0, 0.1, 0.6]])
START = np.array([0.0, 0.0, 0.3]), np.diag([0.0, 0.0, 0.8])
"""A trend of unknown level and slope, and a third coordinate that is known a little, which follows the level."""


def problem(scales, H=H, R=R):
    """The model in other units of its coordinates, and data of it with gaps: single entries, whole frames, the first one."""
    scales = np.asarray(scales)

    def initial(params, inputs):
        numpyro.sample("trend", poseppl.Diffuse(jnp.zeros(2)).to_event(1))
        numpyro.sample("other", dist.Normal(START[0][2] * scales[2], np.sqrt(START[1][2, 2]) * scales[2]))

    def transition(params, state, inputs):
        x = jnp.append(state["trend"], state["other"]) / scales
        moved = scales * (A @ x)
        covariance = Q * np.outer(scales, scales)
        numpyro.sample("trend", dist.MultivariateNormal(moved[:2], covariance[:2, :2]))
        numpyro.sample("other", dist.Normal(moved[2], np.sqrt(covariance[2, 2])))

    def observation(params, state, inputs):
        x = jnp.append(state["trend"], state["other"]) / scales
        if R is None:
            numpyro.sample("y", dist.Delta(H @ x).to_event(1))
        else:
            numpyro.sample("y", dist.MultivariateNormal(H @ x, R))

    rng = np.random.default_rng(1)
    x, ys = np.array([5.0, 1.0, 0.5]), []
    for _ in range(12):
        ys.append(H @ x + (0 if R is None else rng.multivariate_normal(np.zeros(len(H)), R)))
        x = A @ x + rng.multivariate_normal(np.zeros(3), Q)
    ys = np.array(ys)
    if R is not None:
        ys[0, :2] = ys[3] = ys[5, 1] = ys[2, 0] = np.nan
    return poseppl.StateSpaceModel(initial, transition, observation).compile(), ys


def by_least_squares(ys, until, H=H, R=R):
    """Moments of all states given the frames before `until`, and the diffuse log-likelihood, from one large Gaussian.

    States are x = X delta + noise with flat delta; the likelihood of de Jong 1991 is that of the data's residuals, with
    -log |S| / 2 of the information S of delta.
    """
    frames, size = len(ys), 3
    powers = [np.linalg.matrix_power(A, t) for t in range(frames)]
    X = np.concatenate(powers)[:, :2]
    mean = np.concatenate([power @ START[0] for power in powers])
    P = np.zeros((frames * size, frames * size))
    marginal = START[1]
    for t in range(frames):
        for s in range(t, frames):
            block = np.linalg.matrix_power(A, s - t) @ marginal
            P[s * size : (s + 1) * size, t * size : (t + 1) * size] = block
            P[t * size : (t + 1) * size, s * size : (s + 1) * size] = block.T
        marginal = A @ marginal @ A.T + Q
    seen = np.isfinite(ys) & (np.arange(frames) < until)[:, None]
    Z = np.kron(np.eye(frames), H)[seen.ravel()]
    noise = np.kron(np.eye(frames), R)[np.ix_(seen.ravel(), seen.ravel())]
    F = Z @ P @ Z.T + noise
    residual, design = ys.ravel()[seen.ravel()] - Z @ mean, Z @ X
    inverse = np.linalg.inv(F)
    information = design.T @ inverse @ design
    delta = np.linalg.solve(information, design.T @ inverse @ residual)
    left = residual - design @ delta
    gain = P @ Z.T @ inverse
    means = mean + X @ delta + gain @ left
    beside = X - gain @ design
    covariances = P - gain @ Z @ P + beside @ np.linalg.inv(information) @ beside.T
    value = left @ inverse @ left + np.linalg.slogdet(F)[1] + np.linalg.slogdet(information)[1] + seen.sum() * np.log(2 * np.pi)
    blocks = covariances.reshape(frames, size, frames, size)[np.arange(frames), :, np.arange(frames)]
    return means.reshape(frames, size), blocks, -0.5 * value


@pytest.mark.full
@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("scales", [[1.0, 1.0, 1.0], [1e3, 1e-2, 1e4]], ids=["equal", "unequal"])
def test_filter_smoother_and_likelihood_are_exact(scales, double):
    tolerance = 1e-7 if double else 3e-3
    with double_precision(double):
        model, ys = problem(scales)
        found = jax.jit(lambda data: poseppl.scan_filter(poseppl.kalman_filter(model, 1), KEY, data, collect=kept))(
            model.observe({"y": ys})
        )
        smoothed = jax.tree.map(np.asarray, smoothed_moments(model, model.observe({"y": ys})))
        mean, deviation, evidence = map(np.asarray, found.outputs)
    means, covariances, total = by_least_squares(ys, 12)
    deviations = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2)) * scales
    np.testing.assert_allclose((smoothed.mean - means * scales) / deviations, 0.0, atol=tolerance)
    unit = deviations[:, :, None] * deviations[:, None]
    wanted = covariances * np.outer(scales, scales) / unit
    np.testing.assert_allclose(smoothed.covariance / unit, wanted, atol=tolerance)
    for t in (4, 7, 11):
        wanted, spread, _ = by_least_squares(ys, t + 1)
        known = np.sqrt(np.diagonal(spread[t])) * scales
        np.testing.assert_allclose((mean[t] - wanted[t] * scales) / known, 0.0, atol=tolerance)
        np.testing.assert_allclose(deviation[t] / known, 1.0, rtol=tolerance)
    assert evidence.sum() - np.log(scales[0] * scales[1]) == pytest.approx(total, abs=10 * tolerance)
    assert deviation[0, 0] > UNKNOWN / 2 and np.isfinite(mean).all()


def kept(rng_key, state, info, inputs):
    return state.posterior.mean, jnp.sqrt(jnp.diagonal(state.posterior.covariance)), info.log_evidence


@pytest.mark.full
def test_the_likelihood_is_the_limit_of_proper_starts():
    """log p + (q / 2) log kappa, in double precision with kappa 10^9; and its gradient by differences."""

    def level(first):
        def initial(params, inputs):
            numpyro.sample("x", first)

        def transition(params, state, inputs):
            numpyro.sample("x", dist.Normal(state["x"], params["step"]))

        def observation(params, state, inputs):
            numpyro.sample("y", dist.Normal(state["x"], 0.7))

        prior = lambda: numpyro.sample("step", dist.HalfNormal(1.0))  # noqa: E731
        return poseppl.StateSpaceModel(initial, transition, observation, prior).compile()

    data = {"y": np.array([np.nan, 3.0, 2.5, np.nan, 4.0])}
    with double_precision():
        value = lambda model: lambda step: poseppl.log_likelihood(model, {"step": step}, data, poseppl.kalman_filter)  # noqa: E731
        exact, wide = value(level(poseppl.Diffuse())), value(level(dist.Normal(0.0, 10**4.5)))
        found, slope = jax.value_and_grad(exact)(0.4)
        assert float(found) == pytest.approx(float(wide(0.4)) + 0.5 * np.log(1e9), abs=1e-7)
        assert float(slope) == pytest.approx(float(wide(0.4 + 1e-5) - wide(0.4 - 1e-5)) / 2e-5, abs=1e-5)


@pytest.mark.full
@pytest.mark.parametrize("double", [False, True])
def test_data_without_noise(double):
    """The second row of H is twice the first: it is known already, and adds nothing. The answers have a variance of 10^-9."""
    rows = H[[0, 2]]
    with double_precision(double):
        model, ys = problem([1.0, 1.0, 1.0], H, None)
        smoothed = smoothed_moments(model, model.observe({"y": ys}))
        smoothed = jax.tree.map(np.asarray, smoothed)
        evidence = float(poseppl.log_likelihood(model, None, {"y": ys}, poseppl.kalman_filter))
        wrong = ys.copy()
        wrong[6, 1] += 0.1
        impossible = float(poseppl.log_likelihood(model, None, {"y": wrong}, poseppl.kalman_filter))
    means, covariances, total = by_least_squares(ys[:, [0, 2]], 12, rows, 1e-9 * np.eye(2))
    tolerance = 1e-4 if double else 5e-3
    np.testing.assert_allclose(smoothed.mean, means, atol=tolerance)
    np.testing.assert_allclose(smoothed.covariance, covariances, atol=tolerance)
    assert evidence == pytest.approx(total, abs=20 * tolerance)
    assert np.isneginf(impossible)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_entries_that_are_known_add_nothing(dtype):
    """Two sensors of one unknown level without noise, and a third of it with noise; scales that differ by 10^8."""
    with double_precision(dtype == np.float64):
        scale, diffuse = jnp.asarray(np.diag([0.0, 1e4]), dtype), jnp.asarray([[1e-4], [0.0]], dtype)
        start, seen = DiffuseGaussian(jnp.zeros(2, dtype), scale, diffuse, jnp.zeros((), dtype)), jnp.ones(3, bool)
        jacobian = jnp.asarray([[1.0, 0.0], [3.0, 0.0], [1.0, 1.0]], dtype)
        linear = Linear(jnp.zeros(3, dtype), jacobian, jnp.asarray(np.diag([0.0, 0.0, 4.0]), dtype))
        found, value = exactly(start, linear, jnp.asarray([0.7, 2.1, 5.0], dtype), seen)
        residual, variance = 5.0 - 0.7, 1e8 + 4.0
        wanted = np.log(1e4) - np.log(2 * np.pi) - 0.5 * (np.log(variance) + residual**2 / variance)
        assert float(value) == pytest.approx(wanted, rel=1e-5)
        np.testing.assert_allclose(found.mean, [0.7, residual * 1e8 / variance], rtol=1e-5)
        np.testing.assert_allclose(found.scale, np.diag([0.0, np.sqrt(1e8 * 4 / variance)]), atol=1e-5, rtol=1e-3)
        assert not found.diffuse.any()
        assert np.isneginf(exactly(start, linear, jnp.asarray([0.7, 2.2, 5.0], dtype), seen)[1])


def test_rounding_leaves_nothing_of_what_is_known():
    """One sensor in turn: after the first datum the coordinate is known, and the second one adds a usual density."""
    diffuse = jnp.asarray([[0.3, 0.7], [0.1, -0.4]], jnp.float32)
    start = DiffuseGaussian(jnp.zeros(2), jnp.zeros((2, 2)), diffuse, jnp.zeros(()))
    sensor = Linear(jnp.zeros(1), jnp.asarray([[1.7, 0.0]]), jnp.asarray([[0.81]]))
    first, _ = exactly(start, sensor, jnp.asarray([3.4]), jnp.ones(1, bool))
    assert not first.diffuse[0].any() and first.diffuse[1].any()
    np.testing.assert_allclose([first.mean[0], first.scale[0, 0]], [2.0, 0.9 / 1.7], rtol=1e-5)
    again = sensor._replace(mean=1.7 * first.mean[:1])
    second, value = exactly(first, again, jnp.asarray([3.6]), jnp.ones(1, bool))
    variance = 2 * 0.81
    assert float(value) == pytest.approx(-0.5 * (np.log(2 * np.pi * variance) + 0.2**2 / variance), rel=1e-4)
    assert float(second.mean[0]) == pytest.approx(3.5 / 1.7, rel=1e-5)


@pytest.mark.full
def test_algorithms_that_draw_refuse_a_diffuse_start():
    model, ys = problem([1.0, 1.0, 1.0])
    for build in (lambda model: poseppl.particle_filter(model, 10), lambda model: poseppl.ensemble_kalman_filter(model, 10)):
        with pytest.raises(UnsuitableModelError, match="Nothing is known of site 'trend' at the start"):
            poseppl.infer(model, {"y": ys}, build, KEY)
    with pytest.raises(UnsuitableModelError, match="linearisation='first-order'"):
        poseppl.infer(model, {"y": ys}, lambda model: poseppl.kalman_filter(model, linearisation="unscented"), KEY)

    def later(params, state, inputs):
        numpyro.sample("x", poseppl.Diffuse())

    with pytest.raises(ValueError, match="'x' of the transition program is Diffuse"):
        poseppl.StateSpaceModel(lambda params, inputs: later(params, None, inputs), later, later).compile()


@pytest.mark.full
def test_a_result_of_a_diffuse_start():
    model, ys = problem([1.0, 1.0, 1.0])
    result = poseppl.infer(model, {"y": ys}, poseppl.kalman_filter, KEY)
    smoothed = poseppl.smooth(result, rauch_tung_striebel_smoother(model, num_draws=50), KEY)
    means, covariances, _ = by_least_squares(ys, 12)
    np.testing.assert_allclose(smoothed["summary/state_mean"], means, atol=1e-2)
    np.testing.assert_allclose(smoothed["summary/state_sd"], np.sqrt(np.diagonal(covariances, axis1=1, axis2=2)), rtol=1e-2)
    assert np.isfinite(result["posterior/trend"]).all() and (result["summary/trend_sd"].values[0, 0] > 1e14)
