"""Simulation-based calibration finds the exact filter right, a model that does not hold and a posterior that is off wrong."""

from __future__ import annotations

import jax
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from poseppl_models.toys.linear_gaussian import linear_gaussian

import poseppl
from poseppl.diagnostics.calibration import randomised_ranks
from poseppl.diagnostics.simulation_based import calibration_of
from poseppl.errors import InputError
from poseppl.report import plot_ranks

MODEL = linear_gaussian(2, num_observed=1).compile()
KEY, FRAMES = jax.random.key(0), 12


@pytest.fixture(scope="module")
def kalman():
    return poseppl.kalman_filter(MODEL, num_particles=100)


@pytest.mark.slow
def test_the_exact_filter_is_calibrated(kalman):
    found = poseppl.calibrate(MODEL, kalman, KEY, num_frames=FRAMES, num_simulations=100)
    assert found.ranks.shape == (100, FRAMES, 2) and found.names == ("x[0]", "x[1]")
    assert found.chance > 0.01
    assert (found.excess_error < 0.15).all()  # a posterior of half the variance would have an excess above 0.4
    assert "nothing speaks against" in str(found)
    figure = plot_ranks(found)
    assert len(figure.axes) == 2 and len(figure.axes[0].patches) == 10


@pytest.mark.full
@pytest.mark.parametrize("wrong", [{"Q": np.eye(2)}, {"R": [[4.0]]}])
def test_a_model_that_does_not_hold_is_noticed(kalman, wrong):
    truth = linear_gaussian(2, num_observed=1, **wrong).compile()
    found = poseppl.calibrate(MODEL, kalman, KEY, num_frames=FRAMES, num_simulations=100, truth=truth)
    assert found.chance < 1e-3 and "not calibrated" in str(found)


@pytest.mark.full
@pytest.mark.parametrize(("num_particles", "right"), [(1000, True), (5, False)])
def test_too_few_particles_are_noticed(num_particles, right):
    """The posterior of five is too narrow in both coordinates; nothing speaks against that of a thousand."""
    filter = poseppl.particle_filter(MODEL, num_particles)
    found = poseppl.calibrate(MODEL, filter, KEY, num_frames=FRAMES, num_simulations=60)
    assert (found.chance > 0.01) == right
    assert ("not calibrated" in str(found)) != right
    assert right or (found.excess > 4 * found.excess_error).all()


def test_chance_is_uniform_where_ranks_are():
    """At most one in ten of 200 tests of ranks that are alike within each simulation is below a tenth."""
    rng = np.random.default_rng(0)
    chances = [calibration_of(np.repeat(rng.uniform(size=(40, 1, 1)), 30, 1), ("x",)).chance for _ in range(200)]
    assert np.mean(np.array(chances) < 0.1) < 0.1 + 4 * np.sqrt(0.09 / 200)
    # counting frames instead of simulations would accuse most of them
    pooled = [
        calibration_of(np.repeat(rng.uniform(size=(40, 1, 1)), 30, 1).reshape(-1, 1, 1), ("x",)).chance for _ in range(50)
    ]
    assert np.mean(np.array(pooled) < 0.1) > 0.5


def test_many_coordinates_are_judged_together():
    """At most one in ten of 200 tests of twenty coordinates is below a tenth; single tests would reject most."""
    rng = np.random.default_rng(1)
    names = tuple(map(str, range(20)))
    chances = [calibration_of(rng.uniform(size=(40, 1, 20)), names).chance for _ in range(200)]
    assert 0.02 < np.mean(np.array(chances) < 0.1) < 0.1 + 4 * np.sqrt(0.09 / 200)


@pytest.mark.full
def test_ties_are_broken_at_random():
    ranks = randomised_ranks(np.zeros((9, 4)), np.zeros(4), np.array([0.0, 0.25, 0.5, 0.99]))
    np.testing.assert_allclose(ranks, [0.0, 0.25, 0.5, 0.99])
    np.testing.assert_allclose(randomised_ranks(np.arange(9.0)[:, None], np.array([3.5]), np.array([0.5])), 0.45)


def initial(params, inputs):
    numpyro.sample("level", dist.Normal(0.0, 1.0))


def transition(params, state, inputs):
    numpyro.sample("level", dist.Normal(state["level"], 0.3))


def observation(params, state, inputs):
    numpyro.sample("y", dist.Normal(state["level"] + params["offset"], 0.5))


def parameters():
    numpyro.sample("offset", dist.Normal(0.0, 1.0))


def exact_posterior(rng_key, data, scale=1.0):
    """Posterior of the offset, in closed form: data are the offset plus correlated errors."""
    times = np.arange(FRAMES)
    covariance = 1 + 0.09 * np.minimum(times[:, None], times) + 0.25 * np.eye(FRAMES)
    precision = 1 + np.linalg.inv(covariance).sum()
    mean = np.linalg.solve(covariance, np.asarray(data["y"])).sum() / precision
    return {"offset": mean + scale * np.asarray(jax.random.normal(rng_key, (50,))) / np.sqrt(precision)}


@pytest.mark.full
def test_parameters_are_recovered():
    model = poseppl.StateSpaceModel(initial, transition, observation, parameters).compile()
    about = {"num_frames": FRAMES, "num_simulations": 200}
    found = poseppl.calibrate_parameters(model, exact_posterior, KEY, **about)
    assert found.names == ("offset",) and found.ranks.shape == (200, 1, 1) and found.chance > 0.01
    narrow = poseppl.calibrate_parameters(model, lambda key, data: exact_posterior(key, data, 0.6), KEY, **about)
    assert narrow.chance < 1e-3 and narrow.excess[0] > 5 * narrow.excess_error[0]
    shifted = poseppl.calibrate_parameters(
        model, lambda key, data: {"offset": 0.5 + exact_posterior(key, data)["offset"]}, KEY, **about
    )
    assert shifted.chance < 1e-3 and shifted.bias[0] < -5 * shifted.bias_error[0]


@pytest.mark.full
@pytest.mark.parametrize(
    ("returned", "match"),
    [
        ({"other": np.zeros(9)}, r"offset: the posterior returned draws of \['other'\]"),
        ({"offset": np.zeros((4, 9))}, r"offset: the posterior returned draws of shape \(4, 9\) .expected draws \('L',\)"),
        ({"offset": np.zeros(())}, r"offset: the posterior returned draws of shape \(\)"),
    ],
)
def test_draws_of_another_shape_are_no_draws_of_a_parameter(returned, match):
    """Chains side by side would be compared as if each were a draw."""
    model = poseppl.StateSpaceModel(initial, transition, observation, parameters).compile()
    with pytest.raises(InputError, match=match):
        poseppl.calibrate_parameters(model, lambda key, data: returned, KEY, num_frames=2, num_simulations=20)
