from __future__ import annotations

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.bodies.choo_fleet import (
    EDGES,
    LENGTHS,
    NOISE,
    SIGMA_ANGLE,
    SIGMA_POSITION,
    arm,
    full_body,
    lower_body,
    measure,
)
from precision import DTYPES, epsilon, precision

from poseppl.motion.bodies.body import BodyInputs
from poseppl.motion.geometry import look_at, marker_positions, project


@pytest.fixture(params=DTYPES, ids=lambda dtype: dtype.__name__)
def dtype(request):
    with precision(request.param):
        yield request.param


def inputs(body):
    cameras = look_at((0, -5000, 1000), (0, 0, 1000))
    scale = np.where(np.arange(body.tree.dimension) < 3, 50.0, 0.2)
    step = np.where(np.arange(body.tree.dimension) < 3, 15.0, 0.15)
    states = (jnp.asarray(values, float) for values in (body.rest, scale, step))
    return BodyInputs(cameras, jnp.full((1, 17), NOISE), *states, body.tree)


def poses(body, count, seed=0):
    rng = np.random.default_rng(seed)
    spread = np.where(np.arange(body.tree.dimension) < 3, 500.0, 0.4)
    return body.rest + spread * rng.normal(size=(count, body.tree.dimension))


def test_dimensions():
    body = full_body()
    assert body.tree.dimension == 28 and len(body.tree.marker_names) == 17
    assert [len(part().free_coordinates) for part in (full_body, lower_body, arm)] == [28, 10, 4]
    joints = [joint for joint, _ in body.tree.coordinates]
    counts = {joint: joints.count(joint) for joint in joints}
    assert counts["spine"] == 6 and counts["head"] == 3 and counts["pelvis"] == 2 and counts["girdle"] == 1
    assert all(counts[f"{joint}_{side}"] == n for side in "lr" for joint, n in (("hip", 3), ("shoulder", 3), ("knee", 1)))
    assert {name for edge in EDGES for name in edge} == set(body.tree.marker_names)
    assert set(body.aliases) == set(body.tree.marker_names)
    assert body.params == {"sigma_position": SIGMA_POSITION, "sigma_angle": SIGMA_ANGLE}


def test_at_rest():
    """Feet on the ground, right side to the right of one who looks along +Y, knees and elbows bent as they can."""
    body = full_body()
    place = dict(zip(body.tree.marker_names, np.asarray(marker_positions(body.tree, jnp.asarray(body.rest))), strict=True))
    assert abs(place["ankle_l"][2]) < 1 and abs(place["ankle_r"][2]) < 1
    assert place["hip_r"][0] > 0 > place["hip_l"][0]
    assert place["knee_l"][1] > 10 and abs(place["ankle_l"][1]) < 10 and place["wrist_l"][1] > 10
    stature = place["crown"][2]
    assert 1550 < stature < 1750


@pytest.mark.full
def test_every_coordinate_moves_a_marker():
    body = full_body()
    jacobian = jax.jacrev(lambda x: marker_positions(body.tree, x))(jnp.asarray(poses(body, 1)[0]))
    moved = np.asarray(jnp.abs(jacobian).max((0, 1)))
    twist = body.tree.coordinates.index(("head", "Z"))
    assert np.all(np.delete(moved, twist) > 0.5)


@pytest.mark.full
def test_compiled_program(dtype):
    body = full_body()
    frame = inputs(body)
    model = body.program.compile(frame, {name: jnp.asarray(value) for name, value in body.params.items()})
    assert model.dimension == 28
    keys = jax.random.split(jax.random.key(0), 3)
    x = jax.jit(model.sample_initial)(keys[0], frame)
    y = jax.jit(model.sample_transition)(keys[1], x, frame)
    assert x.shape == y.shape == (28,) and x.dtype == dtype
    step = np.asarray(frame.step_scale, np.float64)
    z = np.asarray(y - x, np.float64) / step
    expected = -0.5 * np.sum(z**2) - np.sum(np.log(step)) - 14 * np.log(2 * np.pi)
    # roundings of 28 squares and logarithms; found up to 15
    np.testing.assert_allclose(model.log_transition(y, x, frame), expected, rtol=500 * epsilon(dtype))


@pytest.mark.full
def test_likelihood_of_simulated_data(dtype):
    """Eq. 20 for the true pose, from the program's own simulation; and another pose is far less likely."""
    body = full_body()
    frame = inputs(body)
    model = body.program.compile(frame, {name: jnp.asarray(value) for name, value in body.params.items()})
    x = jnp.asarray(poses(body, 1)[0], dtype)
    data = jax.jit(model.sample_observation)(jax.random.key(1), x, frame)
    points = np.asarray(data["points"], np.float64)
    assert points.shape == (1, 17, 2)
    predicted = np.asarray(project(frame.cameras, marker_positions(body.tree, x)), np.float64)
    square = np.sum((points - predicted) ** 2) / NOISE**2
    assert abs(square - 34) < 5 * np.sqrt(2 * 34)  # chi-square with 34 degrees of freedom
    observation = model.observe({"points": points})
    found = model.log_observation(x, observation, frame)
    # a point that is rounded otherwise is off by some hundred of these, in units of the noise, for each of 17 points
    np.testing.assert_allclose(found, -0.5 * square - 17 * np.log(2 * np.pi * NOISE**2), rtol=2e4 * epsilon(dtype))
    assert found - model.log_observation(x.at[4].add(0.1), observation, frame) > 20


def test_measured_lengths_round_trip():
    """Lengths come back from markers that the body itself made, whatever the poses, up to float32 rounding."""
    rng = np.random.default_rng(0)
    lengths = {name: value * rng.uniform(0.9, 1.1) for name, value in LENGTHS.items()}
    lengths |= {"hip_forward": 45.0, "shoulder_forward": -12.0, "shoulder_drop": -47.0}
    body = full_body(lengths)
    straight = poses(body, 9)
    turning = [i for i, (joint, axis) in enumerate(body.tree.coordinates) if (joint, axis) == ("pelvis", "Y")]
    straight[:, turning] *= 0.0  # a tilt of the pelvis shortens its drop along the spine
    markers = np.asarray(jax.vmap(lambda x: marker_positions(body.tree, x))(jnp.asarray(straight)))
    found = measure({name: markers[:, i] for i, name in enumerate(body.tree.marker_names)})
    assert set(found) == set(LENGTHS)
    for name, value in lengths.items():
        np.testing.assert_allclose(found[name], value, atol=0.01, err_msg=name)


@pytest.mark.full
def test_measuring_what_was_not_seen():
    """Lengths without markers are those of the standard subject, scaled by the limbs that were seen."""
    size = {name: 1.1 * length for name, length in LENGTHS.items()}
    body = full_body(size)
    markers = np.asarray(jax.vmap(lambda x: marker_positions(body.tree, x))(jnp.asarray(poses(body, 5))), np.float64)
    named = {name: markers[:, i].copy() for i, name in enumerate(body.tree.marker_names)}
    named["crown"][:] = np.nan
    named["wrist_l"][:3] = np.nan
    del named["ankle_l"], named["ankle_r"]
    found = measure(named)
    for name in ("head", "shank", "forearm"):
        np.testing.assert_allclose(found[name], size[name], atol=0.01, err_msg=name)
    named["hip_l"][:] = np.nan
    with pytest.raises(ValueError, match="no hip_l among the markers"):
        measure(named)


@pytest.mark.full
def test_lengths_are_plain_numbers():
    assert json.loads(json.dumps(dict(full_body({"thigh": 400.0}).lengths)))["thigh"] == 400.0
