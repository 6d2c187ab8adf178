"""A body's parts repel each other: hardly where they are apart, much where a limb is inside of another part."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.sminchisescu_triggs.body import superquadric_body
from poseppl_models.sminchisescu_triggs.non_penetration import NEAREST, NEAREST_NODES, apart, non_penetration_residuals
from precision import precision

CROSSED = {"shoulder_l_Y": -0.2, "shoulder_l_Z": -1.2, "elbow_l_X": 1.6}
"""The left forearm within the chest."""


def non_penetration(names):
    """The cost f_pa."""
    residuals = non_penetration_residuals(names)
    return lambda *arguments: 0.5 * jnp.sum(residuals(*arguments) ** 2)


def poses(body, number):
    """Random states (N, d) about rest and within the limits."""
    low, high = (np.where(np.isfinite(side), side, body.rest) for side in body.limits.T)
    drawn = body.rest + 0.4 * np.random.default_rng(3).normal(size=(number, len(body.rest)))
    return jnp.asarray(np.clip(drawn, low, high), float)


def pose(body, **angles):
    index = {coordinate: i for i, coordinate in enumerate(body.tree.coordinates)}
    state = np.array(body.rest)
    for key, angle in angles.items():
        state[index[tuple(key.rsplit("_", 1))]] = angle
    return jnp.asarray(state, float)


def test_pairs():
    """All pairs but those that meet at a joint of one side, both ways; the arm's hand and upper arm are left."""
    names = superquadric_body().flesh.names
    found = {(names[i], names[j]) for i, j in apart(names)}
    assert ("hand_l", "chest") in found and ("chest", "hand_l") in found and ("forearm_l", "upper_arm_r") in found
    assert not {("forearm_l", "hand_l"), ("chest", "upper_arm_r"), ("thigh_l", "pelvis")} & found
    assert len(apart(superquadric_body("arm").flesh.names)) == 2


@pytest.mark.full
def test_hardly_anything_apart_and_much_inside():
    """Without the reach of a forearm into the chest no cost is above 1; 30 mm of it cost 50 at least. Legs that cross, too."""
    body = superquadric_body()
    cost = jax.jit(non_penetration(body.flesh.names))
    stepping = {"hip_l_X": 0.6, "hip_r_X": -0.4, "knee_l_X": -0.5, "shoulder_l_X": -0.4, "shoulder_r_X": 0.5}
    for angles in ({}, {"elbow_l_X": 1.6}, stepping, {"shoulder_l_Y": 1.5, "elbow_r_X": 2.2}):
        assert 0 <= cost(pose(body, **angles), body.tree, body.flesh) < 1, angles
    for angles in (CROSSED, {"hip_l_Y": -0.3, "hip_r_Y": 0.3}):
        assert cost(pose(body, **angles), body.tree, body.flesh) > 50, angles
    blind = jax.jit(non_penetration(("chest", "neck")))  # knows of two parts alone, which meet
    assert blind(pose(body, **CROSSED), body.tree, body.flesh) == 0


def test_descent_pulls_limbs_apart():
    """Jacobians equal central differences in float64, at ease and with an arm inside; down the gradient the cost falls."""
    with precision(np.float64):
        body = superquadric_body()
        residuals = jax.jit(lambda x: non_penetration_residuals(body.flesh.names)(x, body.tree, body.flesh))
        rows = jax.jit(jax.jacrev(residuals))
        for arm in ({}, CROSSED):
            state = pose(body, hip_l_X=0.3, thorax_Z=0.1, **arm)  # not its own mirror image: no two pairs are as close
            jacobian = np.asarray(rows(state))
            differences = [(residuals(state + step) - residuals(state - step)) / 2e-6 for step in 1e-6 * np.eye(34)]
            scale = np.abs(jacobian).max()
            np.testing.assert_allclose(jacobian, np.stack(differences, 1), rtol=1e-4, atol=1e-6 * scale)
            np.testing.assert_allclose(jacobian[:, :3], 0, atol=1e-9 * scale)
            value = residuals(state)
            slope = value @ jacobian
            lower = residuals(state - 1e-3 * slope / np.linalg.norm(slope))
            assert jnp.sum(lower**2) < jnp.sum(value**2)


@pytest.mark.full
def test_pairs_that_are_far_from_each_other_do_not_matter():
    """The pairs that count, of 240, and their nodes have 99 % of the cost in 99 of 100 poses; a third of them do not."""
    body = superquadric_body()
    states = poses(body, 400)

    def costs(nearest, nodes=NEAREST_NODES):
        penalty = non_penetration_residuals(body.flesh.names, nearest, nodes)
        return np.asarray(jax.jit(jax.vmap(lambda x: 0.5 * jnp.sum(penalty(x, body.tree, body.flesh) ** 2)))(states), float)

    whole = costs(len(apart(body.flesh.names)), 20 * len(apart(body.flesh.names)))
    missing, of_few, of_nodes = (
        (whole - costs(*number)) / np.maximum(whole, 1.0)
        for number in ((NEAREST,), (NEAREST // 3,), (NEAREST, NEAREST_NODES // 3))
    )
    assert np.quantile(of_nodes, 0.99) > 0.01
    assert np.quantile(whole, 0.8) > 1.0 and np.quantile(missing, 0.99) < 0.01 < np.quantile(of_few, 0.99)
