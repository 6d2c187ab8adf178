"""Trajectories drawn from a model, and the result of a run of any model."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from poseppl_models.toys.linear_gaussian import linear_gaussian

from poseppl.filters import hmc_filter, particle_filter
from poseppl.kernels import HMCSettings
from poseppl.program import StateSpaceModel
from poseppl.runs.collectors import collect_draws
from poseppl.runs.outcome import result_of_run
from poseppl.runs.results import provenance
from poseppl.runs.run import run_filter
from poseppl.runs.simulation import simulate

T = 4


def counting_model(noise: float = 1e-6) -> StateSpaceModel:
    """x_t = x_(t-1) + u_t and y_t = x_t + 10 u_t, exact but for the first state and a little noise."""

    def initial(params, inputs):
        numpyro.sample("x", dist.Normal(inputs, 1.0))

    def transition(params, state, inputs):
        numpyro.sample("x", dist.Normal(state["x"] + inputs, noise))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(10 * inputs + state["x"], noise).expand((2,)))
        numpyro.deterministic("twice", 2 * state["x"])

    return StateSpaceModel(initial, transition, observation)


@pytest.mark.parametrize("length", [1, T])
def test_a_simulation_uses_each_frame_s_own_inputs(length: int) -> None:
    inputs = jnp.array([3.0, 1.0, 20.0, 400.0])[:length]
    model = counting_model().compile(inputs[0])
    states, values = simulate(model, jax.random.key(0), length, inputs)
    assert states.shape == (length, 1) and values["y"].shape == (length, 2)
    np.testing.assert_allclose(np.diff(states[:, 0]), inputs[1:], rtol=1e-5)
    np.testing.assert_allclose(values["y"], (10 * inputs + states[:, 0])[:, None].repeat(2, 1), rtol=1e-5)
    with pytest.raises(ValueError, match="num_frames is 0"):
        simulate(model, jax.random.key(0), 0, inputs)


@pytest.mark.full
def test_simulations_have_the_model_s_moments() -> None:
    """x_1 of the linear Gaussian model is N(A m, A P A' + Q), within five standard errors of 4000 draws."""
    model = linear_gaussian(2, m=[1.0, -1.0]).compile()
    states, _ = jax.vmap(lambda key: simulate(model, key, 2))(jax.random.split(jax.random.key(1), 4000))
    A, draws = np.array([[0.9, 0.1], [0.0, 0.9]]), np.asarray(states[:, 1])
    covariance = A @ A.T + 0.25 * np.eye(2)
    error = np.sqrt(np.diagonal(covariance) / len(draws))
    assert (abs(draws.mean(0) - A @ [1.0, -1.0]) < 5 * error).all()
    assert not (abs(draws.mean(0) - [1.0, -1.0]) < 5 * error).all()
    spread = np.sqrt((covariance**2 + np.outer(np.diagonal(covariance), np.diagonal(covariance))) / len(draws))
    assert (abs(np.cov(draws.T) - covariance) < 5 * spread).all()


def test_the_result_of_particles() -> None:
    inputs = jnp.zeros(T)
    model = counting_model(0.5).compile(inputs[0])
    data = model.observe({"y": np.array([[0.1, 0.1], [np.nan, 0.1], [np.nan, np.nan], [0.1, 0.1]])})
    run = run_filter(particle_filter(model, 50), jax.random.key(0), data, inputs, collect=keep(model))
    tree = result_of_run(run, model, data, truth=np.zeros((T, 1)), frames=[5, 6, 7, 8], attrs={"model": "counting"})
    assert tree["unconstrained_posterior/state"].dims == ("chain", "draw", "frame", "state_dim")
    assert tree["unconstrained_posterior/state"].coords["state_dim"].values.tolist() == ["x"]
    np.testing.assert_allclose(tree["posterior/twice"], 2 * tree["unconstrained_posterior/state"][..., 0])
    np.testing.assert_array_equal(np.isnan(tree["observed_data/y"]), ~np.asarray(data.mask["y"]))
    assert tree["truth/state"].shape == (T, 1)
    assert tree.attrs["num_particles"] == 50
    assert tree["sample_stats/acceptance_rate"].isnull().all() and "unique_ancestors" in tree["sample_stats"].dataset
    np.testing.assert_array_equal(tree["posterior"]["frame"], [5, 6, 7, 8])
    assert provenance(tree)["model"] == "counting" and provenance(tree)["frames_run"] == T


def keep(model):
    return collect_draws(model, max_draws=20)


def test_the_result_of_chains() -> None:
    model = linear_gaussian(2).compile()
    data = model.observe({"y": np.zeros((T, 2))})
    filter = hmc_filter(model, 3, HMCSettings(num_updates=9, num_leapfrog=2, num_warmup=1))
    run = run_filter(filter, jax.random.key(0), data, collect=keep(model))
    tree = result_of_run(run, model)
    assert tree["unconstrained_posterior/state"].shape == (3, 8, T, 2)
    np.testing.assert_array_equal(tree["unconstrained_posterior/state"], np.moveaxis(run.outputs.state, 0, 2))
    assert tree["unconstrained_posterior"]["state_dim"].values.tolist() == ["x[0]", "x[1]"]
    assert "num_particles" not in tree.attrs and "observed_data" not in tree.children
    assert (tree["sample_stats/acceptance_rate"] > 0.3).all()


@pytest.mark.full
def test_one_frame_is_no_sequence() -> None:
    model = linear_gaussian(2).compile()
    scalar = model.observe({"y": np.zeros(2)})
    with pytest.raises(ValueError, match="axis of frames"):
        empty = scalar._replace(values={"y": jnp.zeros(())})
        run_filter(particle_filter(model, 5), jax.random.key(0), empty, collect=keep(model))
