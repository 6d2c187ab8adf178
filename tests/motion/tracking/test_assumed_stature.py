"""A person of unknown stature in one camera: mixtures over statures that were tracked one by one, and no other points."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from poseppl.diagnostics.verdicts import verdicts
from poseppl.motion.bodies.body import body_builder
from poseppl.motion.geometry import marker_positions, project
from poseppl.motion.io import read_calibration
from poseppl.motion.io.json_detectors import read_openpose
from poseppl.motion.keypoints.keypoint_scene import KeypointScene
from poseppl.motion.keypoints.scene import scene_of_keypoints
from poseppl.motion.keypoints.settings import KeypointSettings
from poseppl.motion.tracking import SmoothSettings, TrackSettings, problem_of_result, smooth, track
from poseppl.motion.tracking.assumed_stature import ATTRIBUTE, at_mean_stature, stature_draws
from poseppl.motion.tracking.body_sizes import POPULATION, subject_lengths
from poseppl.motion.tracking.default_body import FOOTED_MODEL
from poseppl.motion.tracking.problem import with_steps, with_tree
from poseppl.motion.tracking.track import usual_walk
from poseppl.runs.contents import flat_draws
from poseppl.runs.outcome import history_of_result
from poseppl.runs.run import Constant
from poseppl.runs.smoothing import run_smoother
from poseppl.smoothers.laplace import laplace_smoother

FRAMES = 4


def _scene(data_dir: Path, frames: str) -> KeypointScene:
    records = read_calibration(data_dir / "pose2sim_balancing" / "calibration" / "Calib_qualisys.toml", "m")
    people = {"cam_03": read_openpose(data_dir / "pose2sim_balancing" / "pose" / "cam03_json")}
    return scene_of_keypoints(KeypointSettings(people, records, rate=60, frames=frames))


@pytest.fixture(scope="module")
def found(data_dir: Path) -> KeypointScene:
    return _scene(data_dir, f"0:{3 * FRAMES}:3")


@pytest.fixture(scope="module")
def filtered(found: KeypointScene) -> xr.DataTree:
    return track(found.scene, TrackSettings(filter="kalman", walk="fixed", max_draws=500)).result


@pytest.fixture(scope="module")
def smoothed(filtered: xr.DataTree) -> xr.DataTree:
    return smooth(filtered, SmoothSettings("laplace"))


def test_draws_are_those_of_a_normal_distribution() -> None:
    draws = stature_draws(POPULATION, (4, 250))
    assert np.isclose(draws.mean(), POPULATION[0]) and abs(draws.std() / POPULATION[1] - 1) < 0.01
    assert np.array_equal(draws, stature_draws(POPULATION, (4, 250)))
    assert abs(np.corrcoef(draws.ravel(), np.arange(1000))[0, 1]) < 5 / np.sqrt(1000)


def told_of_one_camera(tree: xr.DataTree) -> list[str]:
    return [verdict.text for verdict in verdicts(tree) if verdict.text.startswith("One camera: ")]


@pytest.mark.full
def test_the_user_is_warned_where_one_camera_is_not_to_be_trusted(
    found: KeypointScene, filtered: xr.DataTree, smoothed: xr.DataTree
) -> None:
    (of_walk,), (of_both,) = told_of_one_camera(filtered), told_of_one_camera(smoothed)
    assert "omit walk" in of_walk and "assumed-density" not in of_walk
    assert "omit walk" in of_both and "assumed-density" in of_both
    usual = track(found.scene, TrackSettings(filter="kalman", max_draws=500)).result
    assert not told_of_one_camera(usual) and not told_of_one_camera(smooth(usual, SmoothSettings("assumed-density")))
    assert len(told_of_one_camera(smooth(usual, SmoothSettings("laplace")))) == 1


@pytest.mark.full
def test_noise_that_lasts_is_not_called_too_wide(data_dir: Path) -> None:
    """It is wider than the differences between frames, which results of several cameras would report."""
    tree = track(_scene(data_dir, "0:100").scene, TrackSettings(filter="kalman", max_draws=100)).result
    several = tree.copy()
    several.attrs = {name: value for name, value in tree.attrs.items() if name != "layout"}
    wide = ("intervals are too wide; lower noise", "means jitter", "Underconfident")
    alone, others = (
        [word for word in wide if any(word in verdict.text for verdict in verdicts(each))] for each in (tree, several)
    )
    assert not alone and others == list(wide)


def test_the_walk_of_one_camera_is_mean_reverting_where_nobody_says_otherwise(found: KeypointScene) -> None:
    others = found.scene._replace(data=found.scene.data._replace(found={}))
    assert usual_walk(found.scene, TrackSettings()) == "mean-reverting"
    assert usual_walk(found.scene, TrackSettings(sigma_angle=0.5)) == usual_walk(others, TrackSettings()) == "fixed"


@pytest.mark.parametrize("name", ["filtered", "smoothed"])
def test_bodies_of_all_statures_are_seen_where_one_is(name: str, request: pytest.FixtureRequest) -> None:
    """Draws are poses of bodies of their own statures, and no camera sees that they differ."""
    tree = request.getfixturevalue(name)
    posterior, states = tree["posterior"].dataset, flat_draws(tree).values[0, :20, 0]
    statures, cameras = posterior["stature"].values[0, :, 0], problem_of_result(tree).inputs.cameras.value
    for stature, state, markers, points in zip(
        statures[:20], states, posterior["markers"].values[0, :20, 0], posterior["points"].values[0, :20, 0], strict=True
    ):
        body = body_builder(FOOTED_MODEL)(subject_lengths(FOOTED_MODEL, float(stature), None))
        np.testing.assert_allclose(markers, marker_positions(body.tree, jnp.asarray(state)), atol=0.1)  # float32 at 5 m
        np.testing.assert_allclose(points, project(cameras, jnp.asarray(markers)), atol=0.1)
    assert statures.std() == pytest.approx(POPULATION[1], rel=0.02)
    sites = np.concatenate([posterior["spine_position"].values, posterior["spine"].values], -1)
    at = [list(flat_draws(tree).coords["state_dim"].values).index(f"spine.{axis}") for axis in ("tx", "ty", "tz")]
    np.testing.assert_array_equal(sites[..., :3], flat_draws(tree).values[..., at])


@pytest.mark.full
def test_moments_are_those_of_a_mixture_of_statures(filtered: xr.DataTree, smoothed: xr.DataTree) -> None:
    """Gauss and Hermite's three nodes are exact for two moments of what is linear in the stature."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(3)
    weights = weights / weights.sum()
    problem = problem_of_result(filtered)
    history = history_of_result(at_mean_stature(filtered), jax.random.key(0))
    smoother = laplace_smoother(problem.model)
    centre = np.zeros(problem.model.dimension)
    centre[:3] = problem.inputs.cameras.value.centre[0]
    parts = []
    for node in nodes:
        scale = 1 + node * POPULATION[1] / POPULATION[0]
        body = body_builder(FOOTED_MODEL)(subject_lengths(FOOTED_MODEL, POPULATION[0] * scale, None))
        factor = np.where(np.arange(len(centre)) < 3, scale, 1.0)

        def of(values: Any, factor: Any = factor) -> Any:
            return centre + factor * (np.asarray(values) - centre)

        own = problem.inputs
        inputs = with_tree(with_steps(own, own.step_scale * factor), Constant(body.tree))
        inputs = inputs._replace(
            start=Constant(jnp.asarray(of(own.start.value))), start_scale=Constant(own.start_scale.value * factor)
        )
        run: Any = run_smoother(
            smoother,
            jax.random.key(0),
            history._replace(particles=jnp.asarray(of(history.particles))),
            problem.observations,
            inputs,
            collect=problem.collector(500),
        )
        parts.append((run.outputs.summary["state_mean"], run.outputs.summary["state_sd"]))
    means, spreads = (np.stack(values) for values in zip(*parts, strict=True))
    mean = np.tensordot(weights, means, 1)
    spread = np.sqrt(np.tensordot(weights, spreads**2 + (means - mean) ** 2, 1))
    summary = smoothed["summary"].dataset
    np.testing.assert_allclose(summary["state_mean"].values[:, :3], mean[:, :3], atol=2.0)
    np.testing.assert_allclose(summary["state_sd"].values, spread, rtol=0.02)
    assert summary["state_sd"].values[:, :3].max() > 100
    low, high = (summary["state_quantile"].sel(quantile=q).values[:, :3] for q in (0.05, 0.95))
    np.testing.assert_allclose((high - low) / 3.29, spread[:, :3], rtol=0.2)  # 5 errors of 500 draws


@pytest.mark.full
def test_a_stature_that_is_given_is_exact(found: KeypointScene, smoothed: xr.DataTree) -> None:
    assert found.record()[ATTRIBUTE] == list(POPULATION) and "1.69 ± 0.09 m tall" in " ".join(found.notes())
    data = found.scene.data._replace(found={})
    known = smooth(
        track(found.scene._replace(data=data), TrackSettings(filter="kalman", walk="fixed")), SmoothSettings("laplace")
    )
    assert "stature" not in known["posterior"].dataset
    wide, narrow = (np.linalg.norm(tree["summary"].dataset["markers_sd"].values, axis=-1) for tree in (smoothed, known))
    places, centre = smoothed["summary"].dataset["markers_mean"].values, np.asarray(found.scene.cameras.centre[0])
    farther = POPULATION[1] / POPULATION[0] * np.linalg.norm(places - centre, axis=-1)
    assert np.median(wide**2 - narrow**2) == pytest.approx(np.median(farther) ** 2, rel=0.2)


@pytest.mark.full
def test_draws_of_the_mean_stature_come_back(found: KeypointScene, filtered: xr.DataTree) -> None:
    data = found.scene.data._replace(found={})
    known = track(found.scene._replace(data=data), TrackSettings(filter="kalman", walk="fixed", max_draws=500)).result
    np.testing.assert_allclose(flat_draws(at_mean_stature(filtered)).values, flat_draws(known).values, atol=0.01)
    assert at_mean_stature(known) is known
