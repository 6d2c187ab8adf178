"""The flesh of a body at a result's mean states, against trigonometry."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.motion.geometry import Joint, Marker, kinematic_tree
from poseppl.motion.geometry.flesh import Cone, flesh_of
from poseppl.motion.tracking.flesh_places import with_flesh
from poseppl.runs.results import Names, build_result

TREE = kinematic_tree([Joint("hip", None, (0, 0, 0), "X")], [Marker("knee", "hip", (0, 0, -400))])
THIGH = flesh_of(TREE, [Cone("thigh", "hip", 400.0, (80.0, 60.0), axis=(0, 0, -1), across=(1, 0, 0), scale=(1.2, 0.9))])


def _problem(flesh: Any = THIGH, pose: Any = None) -> Any:
    return SimpleNamespace(body=SimpleNamespace(tree=TREE, flesh=flesh), pose=pose)


@pytest.mark.full
def test_parts_turn_with_the_mean_state() -> None:
    angles = np.array([0.0, 0.3, 1.2])
    states = np.zeros((1, 2, 3, TREE.dimension)) + np.array([5.0, 6.0, 7.0, 0.0])
    states[..., 3] = angles
    result = build_result(state=states, names=Names(TREE.coordinate_names))
    flesh = with_flesh(result, _problem())["flesh"].dataset
    expected = np.stack([np.zeros(3), 400 * np.sin(angles), -400 * np.cos(angles)], 1) + [5.0, 6.0, 7.0]
    np.testing.assert_allclose(flesh["tip"][:, 0], expected, atol=1e-2)
    np.testing.assert_allclose(flesh["side"][:, 0], [[1.0, 0.0, 0.0]] * 3, atol=1e-5)
    assert flesh["radii"].values.tolist() == [[80.0, 60.0]] and flesh["part"].values.tolist() == ["thigh"]
    np.testing.assert_allclose(flesh["scales"], [[1.2, 0.9]], rtol=1e-6)


@pytest.mark.full
@pytest.mark.parametrize("problem", [_problem(flesh=None), _problem(pose=jnp.sin)], ids=["no flesh", "the state is no pose"])
def test_other_results_stay_as_they_are(problem: Any) -> None:
    result = build_result(state=np.zeros((1, 2, 3, TREE.dimension)), names=Names(TREE.coordinate_names))
    assert "flesh" not in with_flesh(result, problem).children


@pytest.mark.full
def test_joints_that_were_clamped_leave_no_flesh() -> None:
    result = build_result(state=np.zeros((1, 2, 3, 1)), names=Names(TREE.coordinate_names[3:]))
    assert "flesh" not in with_flesh(result, _problem()).children
