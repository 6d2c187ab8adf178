"""A result keeps what smoothers start from, so that smoothing is right where parts of the state have no noise."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
import xarray as xr

import poseppl
from poseppl.errors import InputError
from poseppl.filters import hidden_markov_filter
from poseppl.runs.algorithms import FILTERS
from poseppl.runs.outcome import history_of_result
from poseppl.runs.smoothing import SmoothingError
from poseppl.smoothers import fixed_lag_smoother, genealogy_smoother, laplace_smoother, particle_gibbs_smoother

KEY = jax.random.key(3)


def oscillator():
    """An AR(2), the second lag carried along."""
    matrix = np.array([[1.6, -0.8], [1.0, 0.0]])

    def initial(params, inputs):
        numpyro.sample("now", dist.Normal(0.0, 1.0))
        numpyro.sample("before", dist.Normal(0.0, 1.0))

    def transition(params, state, inputs):
        numpyro.sample("before", dist.Delta(state["now"]))
        numpyro.sample("now", dist.Normal(1.6 * state["now"] - 0.8 * state["before"], 0.5))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["now"], 0.7))

    return poseppl.StateSpaceModel(initial, transition, observation), matrix, np.diag([0.25, 0.0]), np.array([[1.0, 0.0]]), 0.7


def total():
    """A rate and the sum of all that came of it, as a meter shows it."""
    matrix = np.array([[0.9, 0.0], [0.9, 1.0]])

    def initial(params, inputs):
        numpyro.sample("rate", dist.Normal(0.0, 1.0))
        numpyro.sample("total", dist.Normal(0.0, 1.0))

    def transition(params, state, inputs):
        rate = numpyro.sample("rate", dist.Normal(0.9 * state["rate"], 0.4))
        numpyro.sample("total", dist.Delta(state["total"] + rate))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["total"], 0.6))

    noise = 0.16 * np.ones((2, 2))
    return poseppl.StateSpaceModel(initial, transition, observation), matrix, noise, np.array([[0.0, 1.0]]), 0.6


def constant():
    """A level with a drift that nobody knows and that never changes."""
    matrix = np.array([[1.0, 1.0], [0.0, 1.0]])

    def initial(params, inputs):
        numpyro.sample("level", dist.Normal(0.0, 1.0))
        numpyro.sample("drift", dist.Normal(0.0, 1.0))

    def transition(params, state, inputs):
        numpyro.sample("level", dist.Normal(state["level"] + state["drift"], 0.3))
        numpyro.sample("drift", dist.Delta(state["drift"]))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["level"], 0.8))

    return poseppl.StateSpaceModel(initial, transition, observation), matrix, np.diag([0.09, 0.0]), np.array([[1.0, 0.0]]), 0.8


def smoothed_moments(data, matrix, noise, load, deviation):
    """Means and standard deviations (T, 2) given all data, from the joint Gaussian of the whole trajectory."""
    count = len(data)
    moves = np.zeros((2 * count, 2 * count))  # of the first state and the steps
    for row in range(count):
        for column in range(row + 1):
            moves[2 * row : 2 * row + 2, 2 * column : 2 * column + 2] = np.linalg.matrix_power(matrix, row - column)
    spread = np.kron(np.eye(count), noise)
    spread[:2, :2] = np.eye(2)
    joint, seen = moves @ spread @ moves.T, ~np.isnan(data)
    observe = np.kron(np.eye(count), load)[seen]
    gain = joint @ observe.T @ np.linalg.inv(observe @ joint @ observe.T + deviation**2 * np.eye(seen.sum()))
    covariance = joint - gain @ observe @ joint
    return (gain @ data[seen]).reshape(count, 2), np.sqrt(np.diag(covariance)).reshape(count, 2)


class Posed:
    """A model with data, one frame of them missing, and its exact smoothing distributions."""

    def __init__(self, build, num_frames=8):
        programs, self.matrix, self.noise, load, deviation = build()
        self.model = programs.compile()
        rng = np.random.default_rng(1)
        state, data = rng.normal(size=2), []
        for frame in range(num_frames):
            state = self.matrix @ state + rng.multivariate_normal(np.zeros(2), self.noise) if frame else state
            data.append(load[0] @ state + deviation * rng.normal())
        self.data = np.where(np.arange(num_frames) == 3, np.nan, data)
        self.means, self.deviations = smoothed_moments(self.data, self.matrix, self.noise, load, deviation)


def distance(posed, result):
    """The largest error of a mean, in standard deviations, and the least and largest ratio of those."""
    error = abs(result["summary/state_mean"].values - posed.means) / posed.deviations
    ratio = result["summary/state_sd"].values / posed.deviations
    return error.max(), ratio.min(), ratio.max()


SMOOTHERS = {
    "backward simulation": lambda model: poseppl.backward_simulation_smoother(model, 1000),
    "metropolis": lambda model: poseppl.backward_simulation_smoother(model, 1000, method="metropolis"),
    "forward-backward": poseppl.forward_backward_smoother,
    "genealogy": genealogy_smoother,
    "fixed lag": lambda model: fixed_lag_smoother(model, lag=8),
}


@pytest.mark.parametrize("build", [oscillator, *(pytest.param(each, marks=pytest.mark.full) for each in (total, constant))])
def test_smoothers_of_a_result_are_right_where_a_site_has_no_noise(build, tmp_path):
    """Also from a file. Hundreds of ancestors remain of 5000 particles after 8 frames: 0.3 is several errors."""
    posed = Posed(build)
    result = poseppl.infer(posed.model, {"y": posed.data}, poseppl.particle_filter(posed.model, 5000), KEY)
    poseppl.save_result(result, tmp_path / "filtered.nc")
    read = poseppl.load_result(tmp_path / "filtered.nc")
    for name, make in SMOOTHERS.items():
        error, least, most = distance(posed, poseppl.smooth(read, make(posed.model), KEY))
        assert error < 0.3 and least > 0.75 and most < 1.25, name


@pytest.mark.parametrize(
    ("name", "joint"), [("backward simulation", True), pytest.param("fixed lag", False, marks=pytest.mark.full)]
)
def test_draws_are_trajectories_where_the_result_says_so(name, joint):
    """The lag of a frame is then the state of the frame before, in every draw."""
    posed = Posed(oscillator)
    result = poseppl.infer(posed.model, {"y": posed.data}, poseppl.particle_filter(posed.model, 1000), KEY)
    smoothed = poseppl.smooth(result, SMOOTHERS[name](posed.model), KEY)
    now, before = (smoothed[f"posterior/{site}"].values for site in ("now", "before"))
    assert poseppl.runs.results.provenance(smoothed)["joint"] is joint
    assert np.array_equal(before[..., 1:], now[..., :-1]) is joint


@pytest.mark.parametrize(
    "name",
    ["forward-backward", *(pytest.param(name, marks=pytest.mark.full) for name in ("backward simulation", "metropolis"))],
)
def test_a_smoothing_that_cannot_go_back_is_refused(name):
    """Draws that were resampled frame by frame cannot come from one another; so do those of a Gaussian."""
    posed = Posed(oscillator)
    filters = poseppl.particle_filter(posed.model, 300), poseppl.kalman_filter(posed.model)
    for filter, room in zip(filters, (0, 256), strict=True):
        result = poseppl.infer(posed.model, {"y": posed.data}, filter, KEY, history_mib=room)
        with pytest.raises(SmoothingError, match="frame .* cannot come from any state"):
            poseppl.smooth(result, SMOOTHERS[name](posed.model), KEY)


@pytest.mark.parametrize("make", [laplace_smoother, poseppl.trajectory_smoother])
def test_smoothers_that_need_a_density_refuse_sites_without_noise(make):
    with pytest.raises(ValueError, match="Site 'before' has no noise"):
        make(Posed(oscillator).model)


@pytest.mark.parametrize("name", ["covariance-scaled", "guided", "hmc", "window"])
def test_filters_that_need_a_density_refuse_sites_without_noise(name):
    """Those that only draw from the transition, or take its moments, do not need one."""
    model = Posed(oscillator).model
    with pytest.raises(InputError, match="Site 'before' has no noise"):
        FILTERS[name].build(model, {})
    for other in ("particle", "kalman", "ensemble-kalman", "tempered"):
        FILTERS[other].build(model, {})


@pytest.mark.full
def test_particle_gibbs_of_a_result_is_right_where_a_site_has_no_noise():
    posed = Posed(oscillator)
    result = poseppl.infer(posed.model, {"y": posed.data}, poseppl.particle_filter(posed.model, 500), KEY)
    smoother = particle_gibbs_smoother(posed.model, num_particles=100, num_draws=600)
    error, least, most = distance(posed, poseppl.smooth(result, smoother, KEY))
    assert error < 0.3 and least > 0.8 and most < 1.2


def chain():
    """A hidden Markov chain of three values."""
    matrix = np.array([[0.8, 0.1, 0.1], [0.2, 0.7, 0.1], [0.3, 0.3, 0.4]])

    def initial(params, inputs):
        numpyro.sample("z", dist.Categorical(jnp.array([0.5, 0.3, 0.2])))

    def transition(params, state, inputs):
        numpyro.sample("z", dist.Categorical(jnp.asarray(matrix)[state["z"]]))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(1.5 * state["z"], 1.0))

    return poseppl.StateSpaceModel(initial, transition, observation).compile(), matrix


def smoothed_probabilities(matrix, data):
    """Exact P(z_t | all data) (T, 3)."""
    likelihood = np.exp(-0.5 * (data[:, None] - 1.5 * np.arange(3)) ** 2)
    forward, backward = [np.array([0.5, 0.3, 0.2]) * likelihood[0]], [np.ones(3)]
    for row in likelihood[1:]:
        forward.append(forward[-1] @ matrix * row)
    for row in likelihood[:0:-1]:
        backward.insert(0, matrix @ (row * backward[0]))
    joint = np.array(forward) * np.array(backward)
    return joint / joint.sum(1, keepdims=True)


def test_a_hidden_markov_result_has_its_draws_and_is_smoothed_exactly():
    model, matrix = chain()
    data = np.array([0.1, 1.4, 2.9, 0.2, 3.4])
    result = poseppl.infer(model, {"y": data}, hidden_markov_filter(model), KEY)
    assert result["posterior/z"].sizes["draw"] == 200
    smoothed = poseppl.smooth(result, poseppl.forward_backward_smoother(model), KEY)
    np.testing.assert_allclose(smoothed["summary/z_probability"], smoothed_probabilities(matrix, data), atol=1e-5)
    assert not [found.text for found in poseppl.verdicts(smoothed) if "particles" in found.text]
    ahead = poseppl.forecast(result, model, 1, KEY, num_draws=4000)["forecast/z"].values
    expected = result["summary/z_probability"].values[-1] @ matrix
    shares = np.bincount(ahead.ravel(), minlength=3) / ahead.size
    np.testing.assert_allclose(shares, expected, atol=5 * np.sqrt(0.25 / 4000))


def test_a_gaussian_filter_keeps_its_moments():
    posed = Posed(total)
    result = poseppl.infer(posed.model, {"y": posed.data}, poseppl.kalman_filter, KEY)
    assert set(result["filter_history"].data_vars) == {"mean", "covariance"}
    history = history_of_result(result, KEY)
    covariance = result["filter_history/covariance"].values
    for frame, particles in enumerate(np.asarray(history.particles)):
        error = 5 * np.sqrt(np.diag(covariance[frame]) / len(particles))
        assert (abs(particles.mean(0) - result["filter_history/mean"].values[frame]) < error).all()
        np.testing.assert_allclose(np.cov(particles.T), covariance[frame], atol=0.35 * covariance[frame].max())


@pytest.mark.parametrize("room", [0.05, *(pytest.param(room, marks=pytest.mark.full) for room in (1.0, 0.0))])
def test_a_history_without_room_is_left_out_and_reported(room):
    """20,000 bytes a frame of 1000 particles, with 3 numbers and an ancestor each: 0.12 MiB in all."""
    posed, said = Posed(constant), []

    class Progress:
        """Keep what is said."""

        def advance(self, frames):
            """Nothing is shown."""

        def note(self, message):
            """Keep it."""
            said.append(message)

    filter = poseppl.particle_filter(posed.model, 1000)
    result = poseppl.infer(posed.model, {"y": posed.data}, filter, KEY, history_mib=room, progress=Progress())
    assert ("filter_history" in result.children) == (room == 1.0)
    assert [text.partition(":")[0] for text in said] == ["the filter's history needs 0 MiB, but its limit is 0.05"] * (
        room == 0.05
    )
    if room == 1.0:
        kept = result["filter_history"].to_dataset()
        assert kept["state"].dims == ("frame", "particle", "state_dim") and kept["ancestor"].dims == ("frame", "particle")
        weights = np.exp(kept["log_weight"].values)
        np.testing.assert_allclose(weights.sum(1), 1.0, rtol=1e-4)
        mean = (weights[..., None] * kept["state"].values).sum(1)
        np.testing.assert_allclose(mean, result["summary/state_mean"], rtol=1e-3, atol=1e-3)


@pytest.mark.full
def test_one_series_of_a_batch_is_smoothed_as_a_run_of_its_own():
    posed = Posed(oscillator)
    filter = poseppl.particle_filter(posed.model, 5000)
    batch = poseppl.infer_batch(posed.model, {"y": np.stack([posed.data, posed.data[::-1]])}, filter, KEY, names=["a", "b"])
    one = poseppl.one_series(batch, "a")
    xr.testing.assert_allclose(one["filter_history/state"].isel(frame=0, particle=slice(3)), one["filter_history/state"][0, :3])
    error, least, most = distance(posed, poseppl.smooth(one, SMOOTHERS["backward simulation"](posed.model), KEY))
    assert error < 0.3 and least > 0.8 and most < 1.2


@pytest.mark.full
def test_chains_keep_no_history():
    def initial(params, inputs):
        numpyro.sample("x", dist.Normal(0.0, 1.0))

    def transition(params, state, inputs):
        numpyro.sample("x", dist.Normal(state["x"], 0.5))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["x"], 0.5))

    model = poseppl.StateSpaceModel(initial, transition, observation).compile()
    result = poseppl.infer(model, {"y": [0.1, 0.5]}, poseppl.hmc_filter(model), KEY)
    assert "filter_history" not in result.children
