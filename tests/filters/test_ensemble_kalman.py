"""The ensemble Kalman filter's update against Kalman's of the members, and its tapers and inflations against closed forms."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from law_problems import frame, problem, run
from oracles.kalman import kalman_filter as exact_filter, simulate
from poseppl_models.toys.finite_hmm import finite_hmm
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices, linear_gaussian_model
from scipy.stats import chi2

from poseppl.errors import UnsuitableModelError
from poseppl.filters import ensemble_kalman_filter
from poseppl.filters.ensemble_kalman import _DRIFT
from poseppl.gaussians.ensemble import PredictedData, adapted_inflation, increment, moved, predicted_data, relaxed
from poseppl.gaussians.localisation import Localisation, localise_by_name, localise_by_position
from poseppl.program import StateSpaceModel

RNG = np.random.default_rng(5)
MEMBERS = RNG.normal(size=(30, 4)) @ RNG.normal(size=(4, 4)) + RNG.normal(size=4)
H = RNG.normal(size=(3, 4))
ROOT = np.tril(RNG.normal(size=(3, 3))) + 2 * np.eye(3)
R = ROOT @ ROOT.T
DATA = RNG.normal(size=3)


def kalmans(members, H, R, data):
    """Mean and covariance of Kalman's update of the members' own mean and covariance."""
    mean, covariance = members.mean(0), np.cov(members.T)
    gain = covariance @ H.T @ np.linalg.inv(H @ covariance @ H.T + R)
    return mean + gain @ (data - H @ mean), covariance - gain @ H @ covariance


def updated(form, seen=(True, True, True), members=MEMBERS, key=0, taper=(None, None)):
    with jax.enable_x64(True):
        members = jnp.asarray(members)
        predicted = predicted_data(members @ H.T, jnp.broadcast_to(R, (len(members), 3, 3)), jnp.asarray(DATA), jnp.array(seen))
        by = increment(jax.random.key(key), predicted, form, taper[1])
        return np.asarray(moved(members, by, taper[0])), float(by.log_evidence)


@pytest.mark.parametrize("seen", [(True, True, True), (True, False, True), (False, True, False)])
def test_square_root_form_is_kalmans_update_of_the_members(seen):
    """Mean, covariance and evidence, exactly, with correlated noise and with entries that are missing."""
    members, log_evidence = updated("square-root", seen)
    rows = np.flatnonzero(seen)
    mean, covariance = kalmans(MEMBERS, H[rows], R[np.ix_(rows, rows)], DATA[rows])
    np.testing.assert_allclose(members.mean(0), mean, rtol=1e-10)
    np.testing.assert_allclose(np.cov(members.T), covariance, rtol=1e-9, atol=1e-12)
    spread = H[rows] @ np.cov(MEMBERS.T) @ H[rows].T + R[np.ix_(rows, rows)]
    residual = DATA[rows] - H[rows] @ MEMBERS.mean(0)
    exact = -0.5 * (residual @ np.linalg.solve(spread, residual) + np.linalg.slogdet(2 * np.pi * spread)[1])
    np.testing.assert_allclose(log_evidence, exact, rtol=1e-10)


def test_stochastic_form_has_the_mean_of_kalman_and_its_covariance_on_average():
    """The members' own data have mean zero, so the mean is exact in each run."""
    mean, covariance = kalmans(MEMBERS, H, R, DATA)
    runs = [updated("stochastic", key=key)[0] for key in range(400)]
    np.testing.assert_allclose(runs[7].mean(0), mean, rtol=1e-10)
    found = np.array([np.cov(members.T) for members in runs])
    error = found.std(0, ddof=1) / np.sqrt(len(runs))
    assert (np.abs(found.mean(0) - covariance) < 5 * error).all()


@pytest.mark.parametrize("form", ["square-root", "stochastic"])
def test_a_frame_without_data_changes_no_member(form):
    np.testing.assert_array_equal(updated(form, (False, False, False))[0], MEMBERS)
    assert updated(form, (False, False, False))[1] == 0.0


@pytest.mark.full
@pytest.mark.parametrize("form", ["square-root", "stochastic"])
def test_members_converge_to_kalman_at_the_rate_of_monte_carlo(form):
    """The largest error in means over a sequence falls like one over the root of N."""
    posed = problem()
    scale = np.sqrt(np.diagonal(posed.exact.covariances, axis1=1, axis2=2))
    errors = []
    for count in (100, 6400):
        built = ensemble_kalman_filter(posed.model, count, form=form)
        runs = jax.jit(jax.vmap(lambda key, built=built: run(built, key, posed.observations, posed.inputs)[0].particles))
        means = np.asarray(runs(jax.random.split(jax.random.key(0), 10))).mean(2)
        errors.append(np.sqrt((((means - posed.exact.means) / scale) ** 2).mean()))
    assert 4 < errors[0] / errors[1] < 16  # 8 in expectation


def many(dimension):
    """A damped chain of coordinates on a line, all seen, of which far ones hardly depend on each other."""
    matrices = linear_gaussian_matrices(dimension, R=np.eye(dimension))
    _, ys = simulate(matrices, 10, seed=4)
    model = linear_gaussian_model(matrices).compile()
    return model, model.observe({"y": ys}), exact_filter(matrices, ys)


@pytest.mark.full
def test_localisation_makes_up_for_few_members():
    """30 members of 60 coordinates: the error of means is less than half of that without tapers."""
    model, observations, exact = many(60)
    place = np.arange(60)
    near = localise_by_position(model, {"x": place, "y": place}, 8.0)
    errors = []
    for localisation in (None, near):
        built = ensemble_kalman_filter(model, 30, localisation=localisation)
        states, _ = jax.jit(lambda key, built=built: run(built, key, observations, jnp.zeros(10)))(jax.random.key(0))
        errors.append(np.sqrt(((np.asarray(states.particles).mean(1) - exact.means) ** 2).mean()))
    assert errors[1] < 0.5 * errors[0]


def test_tapered_data_do_not_move_what_is_far():
    taper = np.ones((4, 3))
    taper[2] = 0.0
    for form in ("square-root", "stochastic"):
        members, _ = updated(form, taper=(taper, np.ones((3, 3))))
        np.testing.assert_array_equal(members[:, 2], MEMBERS[:, 2])
        np.testing.assert_allclose(members[:, 0], updated(form)[0][:, 0], rtol=1e-10)
        assert np.abs(members[:, 0] - MEMBERS[:, 0]).max() > 0.1


def test_relaxation_gives_spread_back():
    after = 0.25 * MEMBERS
    found = np.asarray(relaxed(jnp.asarray(after), jnp.asarray(MEMBERS), 0.4))
    np.testing.assert_allclose(found.std(0), (0.6 * 0.25 + 0.4) * MEMBERS.std(0), rtol=1e-5)
    np.testing.assert_allclose(found.mean(0), after.mean(0), rtol=1e-5)


@pytest.mark.parametrize("wanted", [1.0, 1.5])
def test_adaptive_inflation_finds_what_the_innovations_say(wanted):
    """Innovations whose variance is that of deviations times a factor, and noise."""
    rng = np.random.default_rng(3)
    factor, found = jnp.asarray(1.2), []
    step = jax.jit(lambda factor, predicted: adapted_inflation(factor, predicted, 0.04))
    for _ in range(3000):
        deviations = rng.normal(size=(40, 20))
        residual = np.sqrt(wanted**2 + 0.5) * rng.normal(size=20)
        noise, count = 0.5 * np.eye(20), np.asarray(20.0)
        factor = step(factor, PredictedData(*map(jnp.asarray, (deviations, residual, noise, count))))
        found.append(float(factor) ** 2)
    # the drift of 0.04 leaves some hundredths of noise, of which 1 cuts off the lower half
    assert abs(np.mean(found[500:]) - wanted**2) < 0.1
    silent = PredictedData(jnp.zeros((40, 20)), jnp.zeros(20), jnp.eye(20), jnp.zeros(()))
    assert step(factor, silent) == factor


@pytest.mark.full
def test_inflation_widens_the_prediction_alone():
    posed = problem()
    states = []
    for inflation in (1.0, 1.5):
        built = ensemble_kalman_filter(posed.model, 50, inflation=inflation)
        nothing = posed.model.unobserved()
        states.append(jax.jit(built.init)(jax.random.key(0), nothing, frame(posed.inputs, 0))[0].particles)
    np.testing.assert_allclose(states[1].std(0), 1.5 * states[0].std(0), rtol=1e-5)
    np.testing.assert_allclose(states[1].mean(0), states[0].mean(0), atol=1e-6)


def test_tapers_by_position_and_by_name_agree():
    model = linear_gaussian_model(linear_gaussian_matrices(6, 3)).compile()
    by_position = localise_by_position(model, {"x": np.arange(6), "y": np.arange(3)}, 2.0, period=6)
    number = {name: int(name[2]) for name in (*model.coordinate_names, "y[0]", "y[1]", "y[2]")}

    def taper(one, other):
        apart = abs(number[one] - number[other])
        return by_position.states[min(apart, 6 - apart), 0]

    by_name = localise_by_name(model, taper)
    np.testing.assert_allclose(by_name.states, by_position.states, rtol=1e-6)
    np.testing.assert_allclose(by_name.data, by_position.data, rtol=1e-6)
    assert by_position.states[5, 0] == by_position.states[1, 0] > 0 == by_position.states[2, 0]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"num_particles": 1}, "num_particles is 1. Expected at least 2"),
        ({"form": "serial"}, "form is 'serial'"),
        ({"inflation": 0.9}, "inflation is 0.9. Expected a factor of at least 1"),
        ({"relaxation": 1.5}, "relaxation is 1.5"),
        ({"localisation": Localisation(np.ones((3, 2)), np.eye(2))}, r"states have shape \(3, 2\). Expected \(2, 2\)"),
        ({"localisation": Localisation(2 * np.ones((2, 2)), np.eye(2))}, "states have values outside"),
        ({"localisation": Localisation(np.ones((2, 2)), np.zeros((2, 2)))}, "are no correlations"),
    ],
)
def test_settings_are_checked(settings, message):
    with pytest.raises(ValueError, match=message):
        ensemble_kalman_filter(problem().model, **settings)


@pytest.mark.full
def test_positions_are_checked():
    model = problem().model
    with pytest.raises(ValueError, match="positions lacks the site 'y'"):
        localise_by_position(model, {"x": [0, 1]}, 1.0)
    with pytest.raises(ValueError, match=r"Positions of 'x' have shape \(3,\)"):
        localise_by_position(model, {"x": [0, 1, 2], "y": [0, 1]}, 1.0)
    with pytest.raises(ValueError, match="radius is 0"):
        localise_by_position(model, {"x": [0, 1], "y": [0, 1]}, 0)


@pytest.mark.full
def test_unsuitable_models_are_refused():
    chain = finite_hmm([0.6, 0.4], [[0.9, 0.1], [0.2, 0.8]], [[0.7, 0.3], [0.1, 0.9]]).compile()
    with pytest.raises(UnsuitableModelError, match="finite sites"):
        ensemble_kalman_filter(chain)

    def start(params, *rest):
        numpyro.sample("x", dist.Normal(0.0, 1.0))

    counts = StateSpaceModel(start, start, lambda params, state, inputs: numpyro.sample("y", dist.Poisson(jnp.exp(state["x"]))))
    model = counts.compile()
    with pytest.raises(ValueError, match="site 'y' is no plain Normal"):
        ensemble_kalman_filter(model, 5).init(jax.random.key(0), model.observe({"y": 3}))


@pytest.mark.parametrize(("factor", "drift"), [(1.1, 0.3), (2.0, 5.0)])
def test_one_step_of_adaptive_inflation_is_a_product_of_gaussians(factor, drift):
    """Precisions add up: that of the factor up to now, and that of a chi-square of the entries that are seen."""
    rng = np.random.default_rng(8)
    count, members = 3, 12
    deviations = rng.normal(size=(members, count))
    deviations -= deviations.mean(0)
    residual = 4.0 * rng.normal(size=count)
    spread = np.trace(np.linalg.solve(R, np.cov(deviations.T))) / count
    # where deviations are as inflated as is thought, r' R^-1 r / p is that chi-square over p, times b s + 1
    scale = factor**2 * spread + 1
    variance = chi2.var(count) * (scale / (count * spread)) ** 2
    observed = (residual @ np.linalg.solve(R, residual) / count - 1) / spread
    precisions = np.array([1 / drift**2, 1 / variance])
    exact = precisions @ [factor**2, observed] / precisions.sum()
    predicted = PredictedData(*map(jnp.asarray, (deviations, residual, R, float(count))))
    assert exact > 1.2 and abs(exact - factor**2) > 0.05
    np.testing.assert_allclose(adapted_inflation(jnp.asarray(factor), predicted, drift) ** 2, exact, rtol=1e-4)


def test_inflation_is_adapted_by_members_that_are_not_inflated():
    """The next factor is that of the innovations against the first prediction as it was drawn."""
    model = linear_gaussian_model(linear_gaussian_matrices(2)).compile()
    data, key = np.array([2.5, -2.0]), jax.random.key(0)
    drawn = jax.jit(ensemble_kalman_filter(model, 40).init)(key, model.unobserved())[0].particles
    built = ensemble_kalman_filter(model, 40, inflation=1.5, adaptive=True)
    state = jax.jit(built.init)(key, model.observe({"y": data}))[0]
    predicted = predicted_data(drawn, jnp.broadcast_to(0.25 * jnp.eye(2), (40, 2, 2)), jnp.asarray(data), jnp.ones(2, bool))
    expected = adapted_inflation(jnp.asarray(1.5), predicted, _DRIFT)
    np.testing.assert_allclose(state.inflation, expected, rtol=1e-6)
    assert abs(float(expected) - 1.5) > 1e-5


def test_states_and_data_have_tapers_of_their_own():
    """Data that no state hangs together with move nothing, whatever they are to each other."""
    model = linear_gaussian_model(linear_gaussian_matrices(2)).compile()
    built = ensemble_kalman_filter(model, 20, localisation=Localisation(np.array([[1.0, 0.0], [0.0, 0.0]]), np.ones((2, 2))))
    key = jax.random.key(0)
    drawn, moved_ones = (
        np.asarray(jax.jit(built.init)(key, data)[0].particles)
        for data in (model.unobserved(), model.observe({"y": [2.5, -2.0]}))
    )
    np.testing.assert_array_equal(moved_ones[:, 1], drawn[:, 1])
    assert np.abs(moved_ones[:, 0] - drawn[:, 0]).max() > 0.1
