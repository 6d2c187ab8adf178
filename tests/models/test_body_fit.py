"""A body made to fit a person: lengths, stature and poses, against a person who is such a body."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.bodies.anthropometry import segment_lengths
from poseppl_models.bodies.cone_body import MARGIN, fitted_states, fitted_stature, measured_lengths, with_crown
from poseppl_models.darby.body import darby_body
from poseppl_models.du_guan.likelihood import du_guan_body

from poseppl.errors import InputError
from poseppl.motion.geometry import marker_positions
from poseppl.motion.tracking.marker_errors import VIRTUAL_MARKERS

pytestmark = pytest.mark.full


def place_markers(body, states):
    """Places (T, 3) in mm of all of a body's markers in states (T, d)."""
    found = jax.vmap(partial(marker_positions, body.tree))(jnp.asarray(states, float))
    return dict(zip(body.tree.marker_names, np.moveaxis(np.asarray(found, np.float64), 1, 0), strict=True))


def walk(body):
    """Three frames of a step, 40 mm apart, which heads elsewhere."""
    state = np.array(body.rest, float)
    at = {pair: number for number, pair in enumerate(body.tree.coordinates)}
    states = np.tile(state, (3, 1))
    states[:, at["pelvis", "Z"]] = 2.5
    states[:, at["pelvis", "ty"]] = 40.0 * np.arange(3)
    states[:, at["hip_l", "X"]] += 0.3 + 0.1 * np.arange(3)
    states[:, at["elbow_r", "X"]] += 0.6
    return states


def test_lengths_and_stature_of_a_body():
    body = du_guan_body(1600.0, {"forearm": 300.0})
    found = measured_lengths(place_markers(body, walk(body)))
    expected = segment_lengths(1600.0) | {"forearm": 300.0}
    assert found == pytest.approx({name: expected[name] for name in found}, rel=1e-4)
    assert fitted_stature({name: length for name, length in found.items() if name != "forearm"}) == pytest.approx(
        1600.0, rel=1e-4
    )


def test_a_higher_crown_leaves_the_cones():
    body = with_crown(darby_body(), 222.0)
    places = place_markers(body, body.rest[None])
    assert np.linalg.norm(places["crown"] - places["neck"]) == pytest.approx(222.0, rel=1e-4)
    np.testing.assert_array_equal(np.asarray(body.flesh.lengths), np.asarray(darby_body().flesh.lengths))


def test_poses_are_found_within_the_limits():
    """Markers of a walk within 3 mm: what the pull to rest costs. Angles keep clear of the limits."""
    body = du_guan_body()
    places = {name: place for name, place in place_markers(body, walk(body)).items() if name in VIRTUAL_MARKERS}
    states = fitted_states(body, places)
    again = place_markers(body, states)
    assert max(np.abs(again[name] - places[name]).max() for name in places) < 3.0
    assert np.all(states >= body.limits[:, 0] + 0.99 * MARGIN) and np.all(states <= body.limits[:, 1] - 0.99 * MARGIN)


def test_what_is_missing_is_reported():
    body = darby_body()
    with pytest.raises(InputError, match="shoulder"):
        measured_lengths({"pelvis": np.zeros((1, 3)), "neck": np.zeros((1, 3)), "crown": np.zeros((1, 3))})
    with pytest.raises(InputError, match="missing"):
        fitted_states(body, {})
    with pytest.raises(InputError, match="missing"):
        fitted_states(body, {"pelvis": np.full((1, 3), np.nan)})
