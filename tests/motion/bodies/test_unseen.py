"""Unseen parts of a body: against the rank of the kinematics' own derivatives, and by hand."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.bodies.choo_fleet import arm, full_body
from poseppl_models.bodies.footed import footed_body

from poseppl.compilation import double_precision
from poseppl.motion.bodies.opensim import opensim_coordinates, opensim_values
from poseppl.motion.bodies.unseen import unseen_parts
from poseppl.motion.geometry import marker_positions

LIMBS = {f"{part}_{side}" for part in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle") for side in "lr"}
HEAD = ("head.Z", "head.Y", "head.X")


def seen(body, names):
    return np.array([name in names for name in body.tree.marker_names])


def test_a_head_without_points() -> None:
    found = unseen_parts(full_body(), seen(full_body(), LIMBS))
    assert (found.markers, found.coordinates) == (("skull", "crown"), HEAD)


def test_a_head_about_its_own_axis() -> None:
    """Its own turn is one of all three angles."""
    found = unseen_parts(full_body(), seen(full_body(), LIMBS | {"crown"}))
    assert found == ((), HEAD)


def test_a_thigh_above_a_hidden_shank() -> None:
    found = unseen_parts(full_body(), seen(full_body(), (LIMBS | {"crown"}) - {"ankle_r"}))
    assert found == (("ankle_r",), ("hip_rotation_r", "knee_angle_r", *HEAD))


def test_all_of_it() -> None:
    body = footed_body()
    assert unseen_parts(body, seen(body, body.tree.marker_names)) == ((), ())
    assert unseen_parts(body, seen(body, LIMBS)).markers[-3:] == ("heel_r", "big_toe_r", "small_toe_r")


def test_a_clamped_body() -> None:
    """Clamped coordinates are known."""
    assert unseen_parts(arm(), seen(arm(), {"elbow_r"})) == (("wrist_r",), ("arm_rot_r", "elbow_flex_r"))


@pytest.mark.full
@pytest.mark.parametrize("names", [LIMBS, LIMBS - {"ankle_l", "wrist_r"}, LIMBS | {"nose", "heel_l"}])
def test_by_automatic_derivatives(names: set[str]) -> None:
    body = footed_body()
    tree, known = body.tree, seen(body, names)
    with double_precision():
        double = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf), jnp.float64), tree)
        pose = np.random.default_rng(1).uniform(-0.8, 0.8, tree.dimension)
        places = np.asarray(jax.jacrev(lambda x: marker_positions(double, x))(jnp.asarray(pose)))
        angles = np.asarray(jax.jacfwd(lambda x: opensim_values(body._replace(tree=double), x[None])[0])(jnp.asarray(pose)))
    _, values, rows = np.linalg.svd(places[known][..., 6:].reshape(-1, tree.dimension - 6))
    hidden = np.pad(rows[(values > 1e-9 * values[0]).sum() :].T, ((6, 0), (0, 0)))
    markers = np.linalg.norm(places @ hidden, axis=(1, 2)) > 1e-6
    turned = np.linalg.norm(angles @ hidden, axis=1) > 1e-6
    found = unseen_parts(body, known)
    assert found.markers == tuple(name for name, moved in zip(tree.marker_names, markers, strict=True) if moved)
    assert found.coordinates == tuple(each.name for each, moved in zip(opensim_coordinates(body), turned, strict=True) if moved)
