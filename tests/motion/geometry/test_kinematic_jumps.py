"""Kinematic jumps: the camera sees the same image, bones keep their lengths, and a jump back is the pose before."""

from __future__ import annotations

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.bodies.choo_fleet import full_body
from precision import precision

from poseppl.motion.geometry import Joint, Marker, kinematic_tree, marker_positions
from poseppl.motion.geometry.cameras import look_at, project
from poseppl.motion.geometry.kinematic_jumps import kinematic_jumps, limb_poses, limbs_of

BODY = full_body()
HEAD, *LIMBS = limbs_of(BODY.tree)


def posed(seed, number=20):
    """Tree, camera and random poses (N, d) with bent elbows and knees, in float64."""
    rng = np.random.default_rng(seed)
    body = full_body()
    states = np.asarray(body.rest) + rng.normal(size=(number, body.tree.dimension)) * 0.5
    names = body.tree.coordinate_names
    for name, sign in (("elbow_l.X", 1), ("elbow_r.X", 1), ("knee_l.X", -1), ("knee_r.X", -1)):
        states[:, names.index(name)] = sign * rng.uniform(0.2, 1.8, number)
    states[:, :3] = np.asarray(body.rest)[:3]
    camera = look_at((0.0, -4000.0, 1000.0), (100.0, 0.0, 900.0))
    tree = body.tree.with_offsets(*(jnp.asarray(np.asarray(a), float) for a in (body.tree.offsets, body.tree.marker_offsets)))
    return tree, jax.tree.map(lambda a: jnp.asarray(a, float), camera), jnp.asarray(states)


@pytest.mark.full
def test_the_limbs_of_the_body_are_its_arms_and_legs():
    names = [BODY.tree.joint_names[BODY.tree.link_joint[limb.ball]] for limb in (HEAD, *LIMBS)]
    assert sorted(names) == ["head", "hip_l", "hip_r", "shoulder_l", "shoulder_r"]
    ends = {BODY.tree.marker_names[limb.marker] for limb in (HEAD, *LIMBS)}
    assert ends == {"crown", "wrist_l", "wrist_r", "ankle_l", "ankle_r"}


@pytest.mark.full
def test_the_camera_sees_the_same_joints():
    """The image of the hinge is the same in all poses; so is that of the end, if its line of sight meets the sphere."""
    with precision(np.float64):
        tree, camera, states = posed(0)
        jumped = jax.jit(jax.vmap(lambda x: kinematic_jumps(tree)(x, SimpleNamespace(tree=tree, cameras=camera))))(states)
        positions, before = (jax.vmap(jax.vmap(lambda x: marker_positions(tree, x)))(x) for x in (jumped, states[:, None]))
        images, truth = (np.asarray(project(camera, points))[0] for points in (positions, before))
    heads = np.abs(images - truth)[:, 0].max((0, 2))  # the head's one pose comes first; between neck and crown it bends
    assert heads[HEAD.marker] < 1e-9 and heads.max() < 2e-3 and jumped.shape[1] == 13
    off = np.abs(images - truth)[:, 1:].max(-1).reshape(20, 4, 3, -1)
    hinges = [tree.marker_names.index(name) for name in tree.marker_names if name.startswith(("elbow", "knee"))]
    assert off[..., hinges].max() < 1e-9
    assert off[:, :, 0].max() < 1e-9  # the far bone alone always can
    reached = (off.max(-1) < 1e-9).reshape(-1)
    assert reached.mean() > 0.75
    moved = np.linalg.norm(np.asarray(positions) - np.asarray(before), axis=-1)
    assert np.median(moved.max(-1)) > 100.0  # mm


@pytest.mark.full
def test_only_the_limbs_own_coordinates_change_and_bends_keep_their_side():
    with precision(np.float64):
        tree, camera, states = posed(1)
        for limb in LIMBS:
            poses = np.asarray(jax.vmap(lambda x, limb=limb: limb_poses(tree, camera, limb, x))(states))
            changed = np.abs(poses - np.asarray(states)[:, None]).max((0, 1)) > 1e-9
            own = [*tree.angle_index[limb.ball], tree.angle_index[limb.hinge][2 - limb.axis]]
            assert set(np.flatnonzero(changed)) <= set(own)
            assert (np.sign(poses[..., own[-1]]) == np.sign(np.asarray(states)[:, None, own[-1]])).all()


@pytest.mark.full
def test_a_jump_back_is_the_pose_before():
    """The far bone leans over and back; the near bone too, by the pose that is nearest to the first."""
    with precision(np.float64):
        tree, camera, states = posed(2)
        nod = jax.jit(jax.vmap(lambda x: limb_poses(tree, camera, HEAD, x)[0]))
        np.testing.assert_allclose(np.asarray(nod(nod(states)))[:, :6], np.asarray(states)[:, :6], atol=1e-6)
        jump = jax.jit(jax.vmap(lambda x: limb_poses(tree, camera, LIMBS[0], x)))
        once = jump(states)
        back = np.asarray(jump(once[:, 0])[:, 0])
        np.testing.assert_allclose(back, states, atol=1e-6)
        seen = np.abs(np.asarray(project(camera, jax.vmap(lambda x: marker_positions(tree, x))(once[:, 2])))).sum()
        again = np.asarray(jump(once[:, 2]))
        distance = np.abs(again - np.asarray(states)[:, None]).max(-1).min(1)
    assert np.isfinite(seen) and (distance < 1e-6).mean() > 0.6


@pytest.mark.full
def test_mirroring_the_near_bone_alone_is_noticed():
    """An end that merely moves with its bone leaves its line of sight."""
    with precision(np.float64):
        tree, camera, states = posed(3)
        limb = LIMBS[0]
        poses = np.array(jax.vmap(lambda x: limb_poses(tree, camera, limb, x))(states))
        bend = tree.angle_index[limb.hinge][2 - limb.axis]
        poses[:, 1, bend] = np.asarray(states)[:, bend]
        images = project(camera, jax.vmap(lambda x: marker_positions(tree, x))(jnp.asarray(poses[:, 1])))[0]
        truth = project(camera, jax.vmap(lambda x: marker_positions(tree, x))(states))[0]
    assert np.median(np.abs(np.asarray(images - truth))[:, limb.marker].max(-1)) > 1e-3


@pytest.mark.full
@pytest.mark.parametrize("bend", [0.0, 0.3])
def test_straight_limbs_and_float32_make_no_nan(bend):
    states = np.tile(np.asarray(BODY.rest), (2, 1))
    names = BODY.tree.coordinate_names
    states[:, [names.index(f"{joint}.X") for joint in ("elbow_l", "elbow_r", "knee_l", "knee_r")]] = bend
    camera = look_at((0.0, -4000.0, 1000.0), (0.0, 0.0, 900.0))
    inputs = SimpleNamespace(tree=BODY.tree, cameras=camera)
    jumped = jax.jit(jax.vmap(lambda x: kinematic_jumps(BODY.tree)(x, inputs)))(jnp.asarray(states, jnp.float32))
    assert jumped.shape == (2, 13, 28) and np.isfinite(np.asarray(jumped)).all()


@pytest.mark.full
def test_a_tree_without_limbs_is_refused():
    tree = kinematic_tree([Joint("root", None, (0, 0, 0), "ZYX")], [Marker("tip", "root", (0, 0, 1.0))])
    with pytest.raises(ValueError, match="no limb"):
        kinematic_jumps(tree)
