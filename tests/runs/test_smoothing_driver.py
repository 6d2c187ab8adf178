"""The driver of smoothers, and results from run to file."""

from __future__ import annotations

import json
import logging

import arviz_stats
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from law_problems import problem
from poseppl_models.toys.linear_gaussian import linear_gaussian

from poseppl.errors import InputError
from poseppl.filters import particle_filter
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.tracking import SmoothSettings, TrackSettings, observe_motion, smooth, track
from poseppl.motion.tracking.placing import place_cameras
from poseppl.runs.collectors import collect_draws
from poseppl.runs.outcome import result_of_run
from poseppl.runs.results import load_result, save_result
from poseppl.runs.run import Constant, run_filter
from poseppl.runs.smoothing import SmoothingError, mask_failed, run_smoother
from poseppl.smoothers import (
    Smoothed,
    Smoother,
    backward_simulation_smoother,
    collect_history,
    forward_backward_smoother,
    genealogy_smoother,
    rauch_tung_striebel_smoother,
    smoothed_moments,
)
from poseppl.smoothers.base import smoothing_info

POSED = problem()
KEY = jax.random.key(0)


def filtered(observations, num_particles=400):
    return run_filter(particle_filter(POSED.model, num_particles), KEY, observations, POSED.inputs, collect=collect_history)


@pytest.mark.full
def test_a_result_knows_the_smoothed_states(tmp_path):
    run = filtered(POSED.observations)
    smoother = forward_backward_smoother(POSED.model)
    collect = collect_draws(POSED.model, max_draws=50)
    smoothed = run_smoother(smoother, KEY, run.outputs, POSED.observations, POSED.inputs, collect=collect)
    tree = result_of_run(smoothed, POSED.model, POSED.observations, attrs={"seed": 1})
    exact = smoothed_moments(POSED.model, POSED.observations, POSED.inputs)
    found = tree["summary"]["state_mean"].values
    error = np.sqrt(np.diagonal(exact.covariance, axis1=1, axis2=2) / np.asarray(smoothed.info.ess)[:, None])
    assert np.abs((found - exact.mean) / error).max() < 6
    assert tree["unconstrained_posterior"]["state"].shape == (1, 50, 5, 2)
    assert "ess" in tree["sample_stats"]
    assert arviz_stats.ess(tree["posterior"])["x"].shape == (5, 2)
    save_result(tree, tmp_path / "smoothed.nc")
    assert load_result(tmp_path / "smoothed.nc").attrs["num_particles"] == 400


@pytest.mark.full
def test_an_equal_smoothing_compiles_nothing(caplog):
    traced = []

    def copied(rng_key, history, observations, inputs=None):
        traced.append(len(history.particles))
        return Smoothed(history.particles, history.log_weights, smoothing_info(len(history.particles), jnp.asarray(1.0)))

    run, collect = filtered(POSED.observations, 10), collect_draws(POSED.model)
    smoother = Smoother(copied, joint=False, model=POSED.model)
    with jax.log_compiles(), caplog.at_level(logging.WARNING):
        first = run_smoother(smoother, KEY, run.outputs, POSED.observations, POSED.inputs, collect=collect)
        assert any("compil" in message for message in caplog.messages)
        caplog.clear()
        second = run_smoother(smoother, KEY, run.outputs, POSED.observations, POSED.inputs, collect=collect)
        assert caplog.messages == []
    assert traced == [5]
    np.testing.assert_array_equal(first.outputs.state, second.outputs.state)


@pytest.mark.full
def test_trajectories_stay_whole():
    """Draw k is one trajectory: its steps have the spread of the transition, which shuffled ones would not."""
    model = linear_gaussian(1, Q=[[1e-4]], P=[[25.0]], R=[[25.0]], A=[[1.0]]).compile()
    observations = model.observe({"y": np.zeros((8, 1))})
    run = run_filter(particle_filter(model, 300), KEY, observations, collect=collect_history)
    smoother = backward_simulation_smoother(model, 200)
    smoothed = run_smoother(smoother, KEY, run.outputs, observations, collect=collect_draws(model, max_draws=100))
    draws = smoothed.outputs.state[:, 0, :, 0]
    assert draws.shape == (8, 100)
    assert np.abs(np.diff(draws, axis=0)).max() < 0.1 < draws.std()


@pytest.mark.full
def test_trajectories_of_unequal_weights_count_by_them():
    one = jax.tree.map(lambda leaf: leaf[:3], POSED.observations)
    run = run_filter(particle_filter(POSED.model, 2000), KEY, one, POSED.inputs[:3], collect=collect_history)
    log_weights = jnp.where(run.outputs.particles[-1, :, 0] > run.outputs.particles[-1, :, 0].mean(), jnp.log(9.0), 0.0)
    history = run.outputs._replace(log_weights=jnp.broadcast_to(log_weights, run.outputs.log_weights.shape))
    smoother = genealogy_smoother(POSED.model)
    found = run_smoother(smoother, KEY, history, one, POSED.inputs[:3], collect=collect_draws(POSED.model))
    whole = smoother.smooth(KEY, history, one, POSED.inputs[:3])
    weights = np.exp(whole.log_weights[-1])
    wanted, spread = np.einsum("n,tnd->td", weights, whole.particles), np.std(whole.particles, 1)
    # systematic resampling is at most as far off as independent draws
    assert np.all(np.abs(found.outputs.summary["state_mean"] - wanted) < 3 * spread / np.sqrt(2000))
    assert np.abs(whole.particles[-1, :, 0].mean() - wanted[-1, 0]) > 10 * spread[-1, 0] / np.sqrt(2000)


@pytest.mark.full
def test_failed_frames_count_as_unseen():
    wild = POSED.observations._replace(values={"y": POSED.observations.values["y"].at[1].set(1e30)})
    run = filtered(wild)
    assert run.outputs.failed.tolist() == [False, True, False, False, False]
    smoother = rauch_tung_striebel_smoother(POSED.model, num_draws=50)
    collect = collect_draws(POSED.model)
    found = run_smoother(smoother, KEY, run.outputs, wild, POSED.inputs, collect=collect)
    without = mask_failed(POSED.observations, run.outputs.failed)
    again = run_smoother(smoother, KEY, run.outputs, without, POSED.inputs, collect=collect)
    np.testing.assert_array_equal(found.outputs.state, again.outputs.state)


@pytest.mark.full
def test_constant_inputs_are_every_frames():
    constant = jnp.asarray(POSED.inputs[0])
    many = jnp.broadcast_to(constant, POSED.inputs.shape)
    run = run_filter(particle_filter(POSED.model, 100), KEY, POSED.observations, many, collect=collect_history)
    smoother, collect = forward_backward_smoother(POSED.model), collect_draws(POSED.model)
    one = run_smoother(smoother, KEY, run.outputs, POSED.observations, many, collect=collect)
    other = run_smoother(smoother, KEY, run.outputs, POSED.observations, Constant(constant), collect=collect)
    np.testing.assert_array_equal(one.outputs.state, other.outputs.state)


@pytest.mark.full
def test_states_that_are_not_finite_are_never_passed_over():
    def broken(rng_key, history, observations, inputs=None):
        info = smoothing_info(5, jnp.asarray(1.0))
        return Smoothed(history.particles * jnp.nan, history.log_weights, info)

    run = filtered(POSED.observations, 10)
    with pytest.raises(SmoothingError, match="not finite"):
        run_smoother(
            Smoother(broken, joint=False),
            KEY,
            run.outputs,
            POSED.observations,
            POSED.inputs,
            collect=collect_draws(POSED.model),
        )


def small_result(**settings):
    subject = walking_subject("poseppl_models.bodies.choo_fleet:arm", frames="0:6")
    scene = observe_motion(subject, place_cameras(subject.markers, 0.0), ("camera",))
    chosen = TrackSettings(
        "poseppl_models.bodies.choo_fleet:arm", "particle", {"num_particles": 300}, max_draws=200, **settings
    )
    return track(scene, chosen).result


@pytest.mark.full
def test_a_tracking_result_is_smoothed_from_what_it_holds(tmp_path):
    """Also of a body with clamped joints, and after a round trip through a file; twice is refused."""
    tree = small_result()
    save_result(tree, tmp_path / "arm.nc")
    smoothed = smooth(load_result(tmp_path / "arm.nc"), SmoothSettings("forward-backward"))
    assert smoothed["unconstrained_posterior"]["state"].dims == tree["unconstrained_posterior"]["state"].dims
    np.testing.assert_array_equal(smoothed["truth"]["state"], tree["truth"]["state"])
    last = tree["summary"]["state_mean"].values[-1]
    np.testing.assert_allclose(smoothed["summary"]["state_mean"].values[-1], last, atol=1e-4)
    assert np.abs(smoothed["summary"]["state_mean"].values[0] - tree["summary"]["state_mean"].values[0]).max() > 1e-3
    with pytest.raises(InputError, match="smoothed already"):
        smooth(smoothed)


@pytest.mark.slow
def test_smoothers_that_follow_ancestors_take_all_particles_of_the_same_run():
    tree = small_result(history_mib=0)
    count, (frames, _) = 300, tree["summary"]["state_mean"].shape
    none = smooth(tree, SmoothSettings("fixed-lag", {"lag": "0"}))
    kept = smooth(small_result(), SmoothSettings("fixed-lag", {"lag": "0"}))  # whose filter need not run again
    np.testing.assert_array_equal(none["summary"]["state_mean"], kept["summary"]["state_mean"])
    np.testing.assert_allclose(none["summary"]["state_mean"], tree["summary"]["state_mean"], rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(none["sample_stats"]["ess"], tree["sample_stats"]["ess"], rtol=1e-3)
    whole = smooth(tree, SmoothSettings("genealogy", max_draws=count))
    draws = whole["unconstrained_posterior"]["state"].values
    assert draws.shape[:3] == (1, count, frames)
    survivors = [len(np.unique(draws[0, :, frame], axis=0)) for frame in range(frames)]
    assert survivors[0] < 0.2 * survivors[-1] and survivors == sorted(survivors)
    all_frames = smooth(tree, SmoothSettings("fixed-lag", {"lag": str(frames - 1)}))
    np.testing.assert_allclose(
        all_frames["summary"]["state_mean"][0],
        draws[0, :, 0].mean(0),
        atol=float(3 * draws[0, :, 0].std(0).max() / np.sqrt(count)) + 1e-6,
    )


@pytest.mark.full
def test_results_without_a_genealogy_or_its_settings_are_refused():
    tree = small_result(history_mib=0)
    settings = json.loads(tree.attrs["settings"])
    tree.attrs["filter"] = json.dumps("kalman")
    tree.attrs["settings"] = json.dumps({**settings, "linearisation": "first-order", "num_iterations": 1, "schedule": "auto"})
    with pytest.raises(InputError, match="'kalman' has no genealogy.*of the filter particle"):
        smooth(tree, SmoothSettings("genealogy"))
    tree.attrs["filter"] = json.dumps("particle")
    for particles, message in [
        ("many", "'num_particles'"),
        (None, "'num_particles'"),
        (2**26, "more than 4 GiB"),
        (0, "num_particles=0"),
    ]:
        tree.attrs["settings"] = json.dumps({**settings, "num_particles": particles})
        with pytest.raises(InputError, match=message):
            smooth(tree, SmoothSettings("fixed-lag"))


@pytest.mark.full
def test_a_result_without_inputs_is_refused():
    tree = small_result()
    del tree["inputs"]
    with pytest.raises(InputError, match="does not contain its inputs"):
        smooth(tree)
