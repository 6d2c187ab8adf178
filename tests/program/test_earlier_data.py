"""Data that come back, against exact answers in NumPy, with and without missing data."""

from __future__ import annotations

import arviz as az
import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from precision import precision
from scipy import stats

import poseppl
from poseppl.errors import InputError, UnsuitableModelError
from poseppl.filters import hidden_markov_filter
from poseppl.program import with_substeps
from poseppl.runs.online_run import OnlineRun
from poseppl.runs.simulation import draw_sequence
from poseppl.smoothers import pmmh, rauch_tung_striebel_smoother
from poseppl.smoothers.static_parameters import particle_gibbs

KEY = jax.random.key(0)
T = 12
GAPS = [3, 4, 8]


def no_state(params, inputs):
    pass


def no_transition(params, state, inputs, previous):
    pass


def autoregression(params, state, inputs, previous):
    y = previous["y"]
    numpyro.sample("y", dist.Normal(0.6 * y[-1] + 0.2 * y[-2] + 0.1, 0.5))


BEFORE = np.array([0.3, -0.2])


def ar2(impute=True):
    return poseppl.StateSpaceModel(no_state, no_transition, autoregression, before={"y": BEFORE}, impute=impute).compile()


def exact_ar2(num_frames):
    """Mean (T,) and covariance (T, T) of an autoregression: (1 - 0.6 L - 0.2 L^2) y = 0.1 + 0.5 e."""
    matrix = np.eye(num_frames) - 0.6 * np.eye(num_frames, k=-1) - 0.2 * np.eye(num_frames, k=-2)
    offset = np.full(num_frames, 0.1)
    offset[0] += 0.6 * BEFORE[1] + 0.2 * BEFORE[0]
    offset[1] += 0.2 * BEFORE[1]
    inverse = np.linalg.inv(matrix)
    return inverse @ offset, 0.25 * inverse @ inverse.T


def gaussian_given(mean, covariance, seen, values):
    """Moments of what was not seen, and the log-density of what was."""
    known = covariance[np.ix_(seen, seen)]
    gain = covariance[np.ix_(~seen, seen)] @ np.linalg.inv(known)
    log_density = stats.multivariate_normal(mean[seen], known).logpdf(values[seen])
    rest = covariance[np.ix_(~seen, ~seen)] - gain @ covariance[np.ix_(seen, ~seen)]
    return mean[~seen] + gain @ (values[seen] - mean[seen]), rest, log_density


def with_gaps(values, gaps=GAPS):
    kept = np.array(values, np.result_type(values, np.float32))
    kept[gaps] = np.nan
    return kept


SERIES = with_gaps(np.random.default_rng(0).normal(0, 0.6, T).astype(np.float32))


@pytest.fixture(scope="module")
def filtered():
    model = ar2()
    return model, poseppl.infer(model, {"y": SERIES}, poseppl.kalman_filter(model), KEY)


def test_evidence_and_imputed_data_of_an_autoregression_are_exact(filtered):
    model, result = filtered
    mean, covariance, expected = gaussian_given(*exact_ar2(T), ~np.isnan(SERIES), SERIES)
    np.testing.assert_allclose(result["sample_stats/log_evidence"].sum(), expected, atol=1e-4)
    smoothed = poseppl.smooth(result, rauch_tung_striebel_smoother(model), KEY)
    # the datum of a frame is a state of the next one
    later = np.array(GAPS) + 1
    np.testing.assert_allclose(smoothed["summary/y_previous_mean"].values[later], mean, atol=1e-5)
    np.testing.assert_allclose(smoothed["summary/y_previous_sd"].values[later], np.sqrt(np.diag(covariance)), atol=1e-5)
    np.testing.assert_allclose(smoothed["summary/y_previous_mean"].values[1:3], SERIES[:2], atol=1e-6)


def test_forecasts_go_on_with_their_own_data(filtered):
    model, result = filtered
    number = 4000
    ahead = poseppl.forecast(result, model, 4, KEY, num_draws=number)["predictions/y"].values[0]
    mean, covariance = exact_ar2(T + 4)
    seen = np.concatenate([~np.isnan(SERIES), np.zeros(4, bool)])
    values = np.concatenate([SERIES, np.zeros(4)])
    mean, covariance, _ = gaussian_given(mean, covariance, seen, values)
    mean, covariance = mean[-4:], covariance[-4:, -4:]
    variance = np.diag(covariance)
    assert np.all(np.abs(ahead.mean(0) - mean) < 4 * np.sqrt(variance / number))
    # of a sample covariance of Gaussians the variance is (c_ii c_jj + c_ij^2) / n
    error = np.sqrt((np.outer(variance, variance) + covariance**2) / number)
    assert np.all(np.abs(np.cov(ahead.T) - covariance) < 4 * error)


@pytest.mark.full
def test_all_drivers_see_one_model(filtered):
    model, result = filtered
    total = float(result["sample_stats/log_evidence"].sum())
    online = poseppl.Online(poseppl.kalman_filter(model), KEY)
    assert sum(float(online.update({"y": value})[1].log_evidence) for value in SERIES) == pytest.approx(total, abs=1e-4)
    likelihood = poseppl.log_likelihood(model, None, {"y": SERIES}, poseppl.kalman_filter)
    assert float(likelihood) == pytest.approx(total, abs=1e-4)
    predicted = poseppl.hindcast(result, model, 2, KEY, num_draws=20)
    assert predicted["y"].shape == (1, 20, T - 2, 2)
    checked = poseppl.add_predictive(result, model, KEY)
    mean = 0.6 * SERIES[1] + 0.2 * SERIES[0] + 0.1
    expected = stats.norm(mean, 0.5).logpdf(SERIES[2])
    np.testing.assert_allclose(checked["log_likelihood/y"].sel(frame=2), expected, atol=1e-5)


@pytest.mark.full
def test_a_batch_is_its_series(filtered):
    model, result = filtered
    batch = poseppl.infer_batch(model, [{"y": SERIES}, {"y": SERIES[:7]}], poseppl.kalman_filter(model), KEY)
    seen = ~np.isnan(SERIES)
    expected = [gaussian_given(*exact_ar2(number), seen[:number], SERIES[:number])[2] for number in (T, 7)]
    np.testing.assert_allclose(batch["sample_stats/log_evidence"].sum("frame"), expected, atol=1e-4)
    with pytest.raises(InputError, match="missing at frame 3"):
        poseppl.infer_batch(ar2_with_state(), [{"y": SERIES}], lambda model: poseppl.particle_filter(model, 8), KEY)


def test_simulated_data_come_back():
    model, number = ar2(), 600
    states, data = jax.device_get(jax.jit(jax.vmap(lambda key: simulated(model, key)))(jax.random.split(KEY, number)))
    np.testing.assert_allclose(states[:, 1:], data[:, :-1])
    mean, covariance = exact_ar2(4)
    assert np.all(np.abs(data.mean(0) - mean) < 4 * np.sqrt(np.diag(covariance) / number))
    variance = np.diag(covariance)
    error = np.sqrt((np.outer(variance, variance) + covariance**2) / number)
    assert np.all(np.abs(np.cov(data.T) - covariance) < 4 * error)


def simulated(model, key):
    states, values = draw_sequence(model, jax.random.split(key, (4, 2)), None)
    return states[:, 0], values["y"]


# Autoregressive hidden Markov models

PERSISTENCE = np.array([[0.9, 0.1], [0.2, 0.8]])
SLOPES, SCALES = np.array([0.9, -0.5]), np.array([0.3, 0.6])


def regime(params, inputs):
    numpyro.sample("k", dist.Categorical(probs=jnp.array([0.5, 0.5])))


def switch(params, state, inputs, previous):
    numpyro.sample("k", dist.Categorical(probs=jnp.asarray(PERSISTENCE)[state["k"]]))


def emission(params, state, inputs, previous):
    slope, scale = jnp.asarray(SLOPES)[state["k"]], jnp.asarray(SCALES)[state["k"]]
    numpyro.sample("y", dist.Normal(slope * previous["y"][-1], scale))


def ar2_with_state():
    return poseppl.StateSpaceModel(regime, switch, emission, before={"y": [0.5]}).compile()


def test_autoregressive_hidden_markov_model_against_the_forward_algorithm():
    model = ar2_with_state()
    y = np.random.default_rng(1).normal(0, 0.5, 15).astype(np.float32)
    before = np.concatenate([[0.5], y[:-1]])
    emissions = stats.norm(SLOPES * before[:, None], SCALES).pdf(y[:, None])
    result = poseppl.infer(model, {"y": y}, hidden_markov_filter(model), KEY)
    probability, total = np.array([0.5, 0.5]), 0.0
    for t, row in enumerate(emissions):
        predicted = probability if t == 0 else probability @ PERSISTENCE
        probability = predicted * row / (predicted @ row)
        total += np.log(predicted @ row)
        assert result["summary/k_probability"].values[t] == pytest.approx(probability, abs=1e-5)
    assert float(result["sample_stats/log_evidence"].sum()) == pytest.approx(total, abs=1e-4)


# GARCH


def garch(impute):
    def initial(params, inputs):
        numpyro.sample("variance", dist.Delta(1.0))

    def transition(params, state, inputs, previous):
        numpyro.sample("variance", dist.Delta(0.1 + 0.2 * previous["y"][-1] ** 2 + 0.7 * state["variance"]))

    def observation(params, state, inputs, previous):
        numpyro.sample("y", dist.Normal(0.0, jnp.sqrt(state["variance"])))

    return poseppl.StateSpaceModel(initial, transition, observation, before={"y": [0.0]}, impute=impute)


@pytest.mark.parametrize("dtype", [np.float32, pytest.param(np.float64, marks=pytest.mark.full)])
def test_garch_is_its_recursion(dtype):
    y = np.random.default_rng(2).normal(0, 1.5, 20)
    variance = [1.0]
    for value in y[:-1]:
        variance.append(0.1 + 0.2 * value**2 + 0.7 * variance[-1])
    expected = stats.norm(0, np.sqrt(variance)).logpdf(y).sum()
    with precision(dtype):
        model = garch(False).compile()
        found = poseppl.log_likelihood(model, None, {"y": y}, lambda model: poseppl.particle_filter(model, 4))
        assert found.dtype == dtype
        assert float(found) == pytest.approx(expected, rel=1e-5 if dtype == np.float32 else 1e-12)


@pytest.mark.full
def test_garch_with_a_missing_datum_is_an_integral():
    y = np.array([0.5, np.nan, 1.2, -0.3, 0.8])
    nodes, weights = np.polynomial.hermite_e.hermegauss(60)
    total = 0.0
    for node, weight in zip(nodes, weights / weights.sum(), strict=True):
        variance, density = 1.0, 1.0
        for value in y:
            scale = np.sqrt(variance)
            drawn = node * scale if np.isnan(value) else value
            density *= 1.0 if np.isnan(value) else stats.norm(0, scale).pdf(value)
            variance = 0.1 + 0.2 * drawn**2 + 0.7 * variance
        total += weight * density
    model = garch(True).compile()
    runs = [
        np.exp(poseppl.log_likelihood(model, None, {"y": y}, lambda model: poseppl.particle_filter(model, 500), key))
        for key in jax.random.split(KEY, 30)
    ]
    assert abs(np.mean(runs) - total) < 4 * np.std(runs) / np.sqrt(len(runs))


# Noise that transition and observation share


def leverage(impute=True):
    def initial(params, inputs):
        numpyro.sample("h", dist.Normal(0.0, 0.5))

    def transition(params, state, inputs, previous):
        shock = previous["y"][-1] * jnp.exp(-state["h"] / 2)
        numpyro.sample("h", dist.Normal(0.9 * state["h"] + 0.4 * -0.7 * shock, 0.4 * np.sqrt(1 - 0.7**2)))

    def observation(params, state, inputs, previous):
        numpyro.sample("y", dist.Normal(0.0, jnp.exp(state["h"] / 2)))

    return poseppl.StateSpaceModel(initial, transition, observation, before={"y": [0.0]}, impute=impute).compile()


def evidence_on_a_grid(y):
    """Log-evidence of stochastic volatility with leverage, by quadrature over h; a missing datum leaves h its own noise."""
    grid = np.linspace(-5, 5, 801)
    step = grid[1] - grid[0]
    density, total = stats.norm(0, 0.5).pdf(grid), 0.0
    for t, value in enumerate(y):
        if t > 0:
            last = y[t - 1]
            shock = 0.0 if np.isnan(last) else last * np.exp(-grid / 2)
            scale = 0.4 if np.isnan(last) else 0.4 * np.sqrt(1 - 0.7**2)
            density = step * density @ stats.norm((0.9 * grid + 0.4 * -0.7 * shock)[:, None], scale).pdf(grid)
        if not np.isnan(value):
            density = density * stats.norm(0, np.exp(grid / 2)).pdf(value)
        total += np.log(density.sum() * step)
        density = density / (density.sum() * step)
    return total


@pytest.mark.full
@pytest.mark.parametrize("gaps", [[], GAPS], ids=["whole", "gaps"])
def test_stochastic_volatility_with_leverage(gaps):
    y = with_gaps(np.random.default_rng(3).normal(0, 1.0, T).astype(np.float32), gaps)
    expected = evidence_on_a_grid(y)
    model = leverage()
    builder = lambda model: poseppl.particle_filter(model, 2000)  # noqa: E731
    runs = [float(poseppl.log_likelihood(model, None, {"y": y}, builder, key)) for key in jax.random.split(KEY, 10)]
    # exp of each is unbiased; its logarithm is too small by half of its variance
    assert abs(np.mean(runs) + np.var(runs) / 2 - expected) < 4 * np.std(runs, ddof=1) / np.sqrt(len(runs)) + 1e-3


A, C, Q, R, S = 0.8, 1.3, 0.5, 0.4, 0.3


def correlated():
    """x_t+1 = A x_t + w_t and y_t = C x_t + v_t, with Cov(w_t, v_t) = S: w_t given v_t is a regression on it."""

    def initial(params, inputs):
        numpyro.sample("x", dist.Normal(0.0, 1.0))

    def transition(params, state, inputs, previous):
        residual = previous["y"][-1] - C * state["x"]
        numpyro.sample("x", dist.Normal(A * state["x"] + S / R * residual, np.sqrt(Q - S**2 / R)))

    def observation(params, state, inputs, previous):
        numpyro.sample("y", dist.Normal(C * state["x"], np.sqrt(R)))

    return poseppl.StateSpaceModel(initial, transition, observation, before={"y": [0.0]}, impute=True).compile()


def exact_correlated(num_frames):
    """Covariance (2 T, 2 T) of the states and then the data."""
    size = num_frames
    noise = np.zeros((2 * size, 2 * size))  # x_0, w_0, ..., w_T-2, then v
    noise[:size, :size] = np.diag([1.0, *[Q] * (size - 1)])
    noise[size:, size:] = R * np.eye(size)
    for t in range(size - 1):
        noise[t + 1, size + t] = noise[size + t, t + 1] = S
    states = np.linalg.inv(np.eye(size) - A * np.eye(size, k=-1))
    whole = np.block([[states, np.zeros((size, size))], [C * states, np.eye(size)]])
    return whole @ noise @ whole.T


@pytest.mark.parametrize("dtype", [np.float32, pytest.param(np.float64, marks=pytest.mark.full)])
def test_correlated_noise_is_exact(dtype):
    seen = np.concatenate([np.zeros(T, bool), ~np.isnan(SERIES)])
    values = np.concatenate([np.zeros(T), SERIES])
    mean, covariance, expected = gaussian_given(np.zeros(2 * T), exact_correlated(T), seen, values)
    tolerance = 1e-4 if dtype == np.float32 else 1e-10
    with precision(dtype):
        model = correlated()
        result = poseppl.infer(model, {"y": SERIES}, poseppl.kalman_filter(model), KEY)
        np.testing.assert_allclose(result["sample_stats/log_evidence"].sum(), expected, atol=tolerance)
        smoothed = poseppl.smooth(result, rauch_tung_striebel_smoother(model), KEY)
        np.testing.assert_allclose(smoothed["summary/x_mean"], mean[:T], atol=tolerance)
        np.testing.assert_allclose(smoothed["summary/x_sd"], np.sqrt(np.diag(covariance)[:T]), atol=tolerance)


# Data of other kinds


@pytest.mark.full
def test_missing_counts_are_summed_over():
    def observation(params, state, inputs, previous):
        numpyro.sample("y", dist.Poisson(0.5 + 0.6 * previous["y"][-1]))

    model = poseppl.StateSpaceModel(no_state, no_transition, observation, before={"y": [2]}, impute=True).compile()
    assert model.sites["y_previous"].discrete
    y = np.array([1, np.nan, np.nan, 3, 0, np.nan, 2])
    counts = np.arange(60)
    table = stats.poisson(0.5 + 0.6 * counts[:, None]).pmf(counts)
    law, expected = (counts == 2) * 1.0, 0.0
    for value in y:
        law = law @ table
        if not np.isnan(value):
            expected += np.log(law[int(value)])
            law = (counts == value) * 1.0
    builder = lambda model: poseppl.particle_filter(model, 2000)  # noqa: E731
    runs = [float(poseppl.log_likelihood(model, None, {"y": y}, builder, key)) for key in jax.random.split(KEY, 10)]
    assert abs(np.mean(runs) + np.var(runs) / 2 - expected) < 4 * np.std(runs, ddof=1) / np.sqrt(len(runs)) + 1e-3


@pytest.mark.full
def test_a_vector_seen_in_part_comes_back():
    matrix, noise = np.array([[0.5, 0.3], [-0.2, 0.7]]), np.array([[0.5, 0.3], [0.3, 0.4]])

    def observation(params, state, inputs, previous):
        numpyro.sample("y", dist.MultivariateNormal(jnp.asarray(matrix) @ previous["y"][-1], jnp.asarray(noise)))

    model = poseppl.StateSpaceModel(no_state, no_transition, observation, before={"y": np.ones((1, 2))}, impute=True).compile()
    y = np.random.default_rng(4).normal(0, 1, (6, 2)).astype(np.float32)
    y[[1, 3, 3], [0, 0, 1]] = np.nan
    inverse = np.linalg.inv(np.eye(12) - np.kron(np.eye(6, k=-1), matrix))
    mean = inverse @ np.concatenate([matrix @ np.ones(2), np.zeros(10)])
    covariance = inverse @ np.kron(np.eye(6), noise) @ inverse.T
    mean, covariance, expected = gaussian_given(mean, covariance, ~np.isnan(y.ravel()), y.ravel())
    result = poseppl.infer(model, {"y": y}, poseppl.kalman_filter(model), KEY)
    np.testing.assert_allclose(result["sample_stats/log_evidence"].sum(), expected, atol=1e-4)
    particles = poseppl.particle_filter(model, 4000)
    runs = [float(poseppl.log_likelihood(model, None, {"y": y}, lambda _: particles, key)) for key in jax.random.split(KEY, 8)]
    assert abs(np.mean(runs) + np.var(runs) / 2 - expected) < 4 * np.std(runs, ddof=1) / np.sqrt(len(runs)) + 1e-3


@pytest.mark.full
def test_what_is_imputed_depends_on_the_inputs_of_its_own_frame():
    def observation(params, state, inputs, previous):
        numpyro.sample("y", dist.Normal(0.5 * previous["y"][-1] + inputs["push"] * inputs["gain"], 1.0))

    programs = poseppl.StateSpaceModel(no_state, no_transition, observation, before={"y": [0.0]}, impute=True)
    model = programs.compile({"push": 0.0, "gain": 1.0})
    push, y = np.array([1.0, 5.0, -2.0], np.float32), np.array([0.2, np.nan, 0.4])
    # y_1 ~ N(0.1 + 10, 1), y_2 ~ N(0.5 y_1 - 4, 1)
    expected = stats.norm(2.0, 1.0).logpdf(0.2) + stats.norm(0.5 * 10.1 - 4.0, np.sqrt(1.25)).logpdf(0.4)
    inputs = {"push": push, "gain": poseppl.Constant(2.0)}
    result = poseppl.infer(model, {"y": y}, poseppl.kalman_filter(model), KEY, inputs)
    np.testing.assert_allclose(result["sample_stats/log_evidence"].sum(), expected, rtol=1e-5)
    online = poseppl.Online(poseppl.kalman_filter(model), KEY)
    updates = [online.update({"y": value}, {"push": each, "gain": 2.0}) for value, each in zip(y, push, strict=True)]
    np.testing.assert_allclose(sum(info.log_evidence for _, info in updates), expected, rtol=1e-5)
    last = poseppl.infer(
        model, {"y": y[:2]}, poseppl.kalman_filter(model), KEY, {"push": push[:2], "gain": poseppl.Constant(2.0)}
    )
    with pytest.raises(InputError, match="data of frame 1 are missing"):
        poseppl.forecast(last, model, 1, KEY, {"push": push[2:], "gain": poseppl.Constant(2.0)})


# # Errors


def test_missing_data_are_refused():
    model = ar2_with_state()
    with pytest.raises(InputError, match="'y' is missing at frame 3 .*impute=True"):
        poseppl.infer(model, {"y": SERIES}, hidden_markov_filter(model), KEY)
    online = poseppl.Online(hidden_markov_filter(model), KEY)
    online.update({"y": np.nan})
    with pytest.raises(InputError, match="'y' is missing"):
        online.update({"y": 0.1})


@pytest.mark.full
def test_missing_data_that_no_check_sees_give_no_evidence():
    model = ar2_with_state()
    data = model.observe({"y": SERIES})
    found = jax.jit(lambda data: poseppl.scan_filter(hidden_markov_filter(model), KEY, data).outputs.log_evidence)(data)
    assert not np.isfinite(found[4:6]).any()


@pytest.mark.parametrize(
    ("before", "message"),
    [
        ({}, "names no site"),
        ({"z": [0.0]}, "'z' is no data site"),
        ({"y": 0.0}, "the last p values"),
        ({"y": np.zeros((1, 2))}, "float of shape"),
        ({"y": [np.nan]}, "not finite"),
    ],
)
def test_values_before_the_first_frame_are_checked(before, message):
    def observation(params, state, inputs, previous):
        numpyro.sample("y", dist.Normal(0.0, 1.0))

    with pytest.raises(InputError, match=message):
        poseppl.StateSpaceModel(regime, switch, observation, before=before).compile()


def test_a_heuristic_likelihood_imputes_nothing():
    def observation(params, state, inputs, previous):
        numpyro.sample("y", dist.Normal(0.0, 1.0))
        numpyro.factor("more", previous["y"][-1])

    with pytest.raises(ValueError, match="'more' is a factor"):
        poseppl.StateSpaceModel(regime, switch, observation, before={"y": [0.0]}, impute=True).compile()


@pytest.mark.full
def test_sub_steps_read_earlier_data():
    programs = poseppl.StateSpaceModel(
        lambda params, inputs: numpyro.sample("x", dist.Normal(0.0, 1.0)),
        lambda params, state, inputs, previous: numpyro.sample("x", dist.Normal(0.5 * state["x"] + previous["y"][-1], 1.0)),
        lambda params, state, inputs, previous: numpyro.sample("y", dist.Normal(state["x"], 1.0)),
        before={"y": [0.0]},
    )
    model = with_substeps(programs, 2).compile()
    found = float(poseppl.log_likelihood(model, None, {"y": [1.0, -1.0]}, poseppl.kalman_filter))
    # x_0 | y_0 = 1 is N(1 / 2, 1 / 2), then twice x' = 0.5 x + 1 + N(0, 1)
    mean, variance = 0.25 * 0.5 + 1.5, 0.25**2 * 0.5 + 1.25
    expected = stats.norm(0, np.sqrt(2)).logpdf(1.0) + stats.norm(mean, np.sqrt(variance + 1)).logpdf(-1.0)
    assert found == pytest.approx(expected, abs=1e-4)


@pytest.mark.full
def test_a_run_in_parts_reads_the_data_of_the_part_before():
    model = ar2()
    filter, data = poseppl.kalman_filter(model), model.observe({"y": SERIES})
    parts = [jax.tree.map(lambda leaf, part=part: leaf[part], data) for part in (slice(0, 5), slice(5, 10))]
    run = OnlineRun(filter, KEY, parts[0], collect=poseppl.collect_draws(model), note=print)
    run.add(parts[1])
    whole = poseppl.scan_filter(filter, KEY, data).outputs.log_evidence[:10]
    np.testing.assert_allclose(run.finish().info.log_evidence, whole, atol=1e-5)


# Smoothing and parameters


@pytest.mark.full
def test_backward_simulation_imputes_too(filtered):
    model, _ = filtered
    mean, covariance, _ = gaussian_given(*exact_ar2(T), ~np.isnan(SERIES), SERIES)
    result = poseppl.infer(model, {"y": SERIES}, poseppl.particle_filter(model, 2000), KEY)
    smoothed = poseppl.smooth(result, poseppl.backward_simulation_smoother(model), KEY)
    error = np.abs(smoothed["summary/y_previous_mean"].values[np.array(GAPS) + 1] - mean) / np.sqrt(np.diag(covariance))
    assert np.all(error < 4 / np.sqrt(200))  # draws share ancestors
    with pytest.raises(UnsuitableModelError, match="'y_previous' has no noise"):
        poseppl.trajectory_smoother(model)


def slope_model():
    """A level that data add up to with what they were before, by an unknown slope."""
    return poseppl.StateSpaceModel(
        lambda params, inputs: numpyro.sample("x", dist.Normal(0.0, 0.5)),
        lambda params, state, inputs, previous: numpyro.sample("x", dist.Normal(0.5 * state["x"], 0.5)),
        lambda params, state, inputs, previous: numpyro.sample(
            "y", dist.Normal(params["slope"] * previous["y"][-1] + state["x"], 0.4)
        ),
        lambda: numpyro.sample("slope", dist.Normal(0.0, 0.7)),
        before={"y": [0.0]},
        impute=True,
    ).compile()


@pytest.mark.full
def test_the_gradient_of_the_evidence_goes_through_missing_data():
    with precision(np.float64):
        model = slope_model()

        def evidence(slope):
            return poseppl.log_likelihood(model, {"slope": slope}, {"y": SERIES}, poseppl.kalman_filter)

        found = jax.jit(jax.grad(evidence))(0.6)
        ahead, behind = jax.jit(jax.vmap(evidence))(jnp.array([0.6 + 1e-5, 0.6 - 1e-5]))
        assert float(found) == pytest.approx(float(ahead - behind) / 2e-5, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("sampler", ["pmmh", "particle_gibbs"])
def test_parameters_have_their_posterior(sampler):
    model = slope_model()
    data = model.observe({"y": SERIES})
    grid = jnp.linspace(-2, 2, 201)
    evidence = jax.vmap(lambda slope: poseppl.log_likelihood(model, {"slope": slope}, data, poseppl.kalman_filter))(grid)
    weights = jax.nn.softmax(evidence - 0.5 * (grid / 0.7) ** 2)
    mean = float(weights @ grid)
    sd = float(jnp.sqrt(weights @ (grid - mean) ** 2))
    if sampler == "pmmh":
        run = pmmh(model, KEY, data, build_filter=lambda model: poseppl.particle_filter(model, 100), num_draws=1000)
    else:
        run = particle_gibbs(model, KEY, data, num_particles=30, num_chains=4, num_draws=1000, num_warmup=200)
    draws = np.asarray(run.params["slope"])
    ess = float(az.ess(draws))
    assert abs(draws.mean() - mean) < 4 * sd / np.sqrt(ess)
    assert draws.std() == pytest.approx(sd, rel=4 / np.sqrt(ess))


@pytest.mark.full
def test_imputing_changes_nothing_where_data_are_complete():
    """Both programs read two earlier data, each with weights of its own."""

    def transition(params, state, inputs, previous):
        numpyro.sample("x", dist.Normal(0.5 * state["x"] + 0.7 * previous["y"][-1] - 0.2 * previous["y"][-2], 0.5))

    def observation(params, state, inputs, previous):
        numpyro.sample("y", dist.Normal(state["x"] + 0.3 * previous["y"][-2], 0.4))

    programs = poseppl.StateSpaceModel(
        lambda params, inputs: numpyro.sample("x", dist.Normal(0.0, 0.5)), transition, observation
    )
    y = np.random.default_rng(6).normal(0, 1, 6).astype(np.float32)
    found = []
    for impute in (False, True):
        model = programs._replace(before={"y": BEFORE}, impute=impute).compile()
        found.append(float(poseppl.log_likelihood(model, None, {"y": y}, poseppl.kalman_filter)))
    assert found[0] == pytest.approx(found[1], abs=1e-4)
    # the first frame's transition is not made, and the second one reads the first datum and the last before it
    mean, variance, total = 0.0, 0.25, 0.0
    values = np.concatenate([BEFORE, y])
    for t in range(6):
        if t > 0:
            mean, variance = 0.5 * mean + 0.7 * values[t + 1] - 0.2 * values[t], 0.25 * variance + 0.25
        residual, spread = y[t] - mean - 0.3 * values[t], variance + 0.16
        total += stats.norm(0, np.sqrt(spread)).logpdf(residual)
        mean, variance = mean + variance / spread * residual, variance - variance**2 / spread
    assert found[0] == pytest.approx(total, abs=1e-4)
