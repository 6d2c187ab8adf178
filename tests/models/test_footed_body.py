"""The body with feet and a face: what its angles mean, and that measuring a body gives its lengths."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.bodies.footed import FACE_LENGTHS, FOOT_LENGTHS, LENGTHS, footed_body, measure

from poseppl.motion.bodies.opensim import opensim_coordinates, opensim_values
from poseppl.motion.tracking.default_body import DEFAULT_MODEL, FOOTED_MODEL, model_of_points


def places_of(body, states):
    return dict(zip(body.tree.marker_names, np.moveaxis(body.places(states), 1, 0), strict=True))


def standing(body, **angles):
    state = np.asarray(body.rest).copy()
    for name, value in angles.items():
        state[body.tree.coordinate_names.index(f"{name[:-2]}.{name[-1]}")] = value
    return state


def test_measuring_gives_the_lengths_that_it_was_built_with() -> None:
    rng = np.random.default_rng(0)
    body = footed_body({name: value * rng.uniform(0.8, 1.2) for name, value in LENGTHS.items()} | {"foot_side": 6.0})
    states = body.rest + np.where(np.arange(body.tree.dimension) < 3, 100.0, 0.4) * rng.normal(size=(40, body.tree.dimension))
    found = measure(places_of(body, states))
    for name in (*FOOT_LENGTHS, *FACE_LENGTHS):
        np.testing.assert_allclose(found[name], body.lengths[name], atol=0.05, err_msg=name)


def test_lengths_without_points_are_in_proportion() -> None:
    body = footed_body({name: 1.1 * value for name, value in LENGTHS.items()})
    hidden = ("heel", "big_toe", "small_toe", "nose", "eye", "ear")
    seen = {name: place for name, place in places_of(body, body.rest[None]).items() if not name.startswith(hidden)}
    found = measure(seen)
    for name in (*FOOT_LENGTHS, *FACE_LENGTHS):
        np.testing.assert_allclose(found[name], 1.1 * LENGTHS[name], atol=1e-3, err_msg=name)
    without = {name: place for name, place in places_of(body, body.rest[None]).items() if "small_toe" not in name}
    assert measure(without)["toe_side"] == 0.0


@pytest.mark.parametrize("side", ["r", "l"])
def test_what_is_positive_at_an_ankle(side: str) -> None:
    body = footed_body()
    level = places_of(body, standing(body)[None])
    np.testing.assert_allclose(
        [level[f"{part}_{side}"][0, 2] for part in ("heel", "big_toe", "small_toe")], level[f"heel_{side}"][0, 2], atol=1.0
    )
    lifted = places_of(body, standing(body, **{f"ankle_{side}_X": 0.3})[None])
    assert lifted[f"big_toe_{side}"][0, 2] > level[f"big_toe_{side}"][0, 2] + 30.0
    mirror = 1.0 if side == "r" else -1.0
    state = standing(body, **{f"ankle_{side}_X": 0.3, f"ankle_{side}_Y": 0.2 * mirror})
    inverted = places_of(body, state[None])
    assert inverted[f"big_toe_{side}"][0, 2] > inverted[f"small_toe_{side}"][0, 2]  # the inner edge is up
    names = [each.name for each in opensim_coordinates(body)]
    values = np.asarray(opensim_values(body, jnp.asarray(state[None], float)))[0]
    for name, expected in (("ankle_angle", 0.3), ("subtalar_angle", 0.2)):
        np.testing.assert_allclose(values[names.index(f"{name}_{side}")], np.rad2deg(expected), atol=1e-3)


def test_the_body_follows_from_the_points() -> None:
    feet = ["heel_l", "heel_r", "big_toe_l", "big_toe_r"]
    assert model_of_points([*feet, "hip_l"]) == FOOTED_MODEL
    assert model_of_points(feet[:3]) == model_of_points(["ankle_l"]) == DEFAULT_MODEL
